"""The hulls and surface colors of a take, frame by frame, from the blocks of its stages.

No stage and no arithmetic: the part of a store function that the stages after coloring share.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from storage.blocks import Block, read_block
from storage.places import Place
from tasks.geometry.left_out import are_of, leave_out
from tasks.geometry.voxels import (
    VoxelGrid,
    VoxelRuns,
    count_voxels,
    decode_runs,
    take_frame,
    voxel_index,
    voxel_numbers,
)

_MOST_HELD = 2
"""How many blocks are held [blocks]. Neighbors in time may be of two."""

_Held = TypeVar("_Held")


class VoxelFrames:
    """A take's frames, read when they are asked for; neighbors are cheap, two blocks are held.

    Colors, which are most of what there is, are read only where they are asked for.
    """

    def __init__(
        self,
        place: Place,
        grid: VoxelGrid,
        hulls: Sequence[Block],
        colors: Sequence[Block] = (),
        still: Block | None = None,
    ) -> None:
        """Open what `carve_block` and `color_block` wrote, in the order of the frames.

        Without `colors` the frames have no `surface`. With `still`, which `find_still_take` wrote,
        they are without its voxels.
        """
        self.grid = grid
        self.start, self.end = hulls[0].start, hulls[-1].end
        self._ends = np.array([block.end for block in hulls])
        self._hulls, self._colors = hulls, colors
        self._place = place
        self._held_hulls: dict[int, VoxelRuns] = {}  # the one asked for last is the last
        self._held_colors: dict[int, dict[str, NDArray]] = {}
        self._lock = threading.Lock()
        self._still: NDArray[np.bool_] | None = None
        self._moving: VoxelRuns | None = None
        things = read_block(place, still) if still else {}
        if len(things.get("start", ())):
            one = np.array([0, len(things["start"])])
            runs = VoxelRuns(things["start"], things["length"], one, grid.shape)
            self._still = decode_runs(runs, 0).ravel()
        if len(things.get("moving_start", ())):
            start, length, offset = (things[f"moving_{n}"] for n in ("start", "length", "offset"))
            self._moving = VoxelRuns(start, length, offset, grid.shape)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.end - self.start

    def hull(self, frame: int) -> VoxelRuns:
        """Return the hull of a frame, as runs of a single frame."""
        return take_frame(*self._find(frame)[1:])

    def index(self, frame: int) -> NDArray[np.int32]:
        """Return (voxel, 3) the index of each voxel of a frame, in order."""
        return voxel_index(*self._find(frame)[1:])

    def surface(self, frame: int) -> tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]:
        """Return which voxels of a frame are on the surface, and these voxels' color and camera.

        Returns
        -------
        is_surface : (voxel,) bool
        color : (surface voxel, 3) uint8
            RGB.
        camera : (surface voxel,) uint8
            `storage.schema.NO_CAMERA` where no camera sees the voxel.
        """
        number, runs, inside = self._find(frame)
        colors = self._hold(self._held_colors, number, lambda: self._read_colors(number, runs))
        voxels = slice(*colors["voxels"][inside : inside + 2])
        surface = slice(*colors["offset"][inside : inside + 2])
        return colors["is_surface"][voxels], colors["color"][surface], colors["camera"][surface]

    def hulls(self, first: int, end: int) -> Iterator[VoxelRuns]:
        """Yield the hulls of the frames from `first` to before `end`."""
        return (self.hull(frame) for frame in range(first, end))

    def _find(self, frame: int) -> tuple[int, VoxelRuns, int]:
        """Return the number of the block of a frame, its hulls, and the frame's place in it."""
        number = self._number(frame)
        runs = self._hold(self._held_hulls, number, lambda: self._read_hulls(number))
        return number, runs, frame - self._hulls[number].start

    def _number(self, frame: int) -> int:
        """Return the number of the block of a frame."""
        if not self.start <= frame < self.end:
            raise IndexError(f"frame {frame} is not one of {self.start} to {self.end - 1}")
        return int(np.searchsorted(self._ends, frame, side="right"))

    def _hold(self, held: dict[int, _Held], number: int, read: Callable[[], _Held]) -> _Held:
        """Return what is held of a block, or else read it."""
        with self._lock:  # so that threads read a block once
            block = held.pop(number, None)
            while block is None and len(held) >= _MOST_HELD:
                del held[next(iter(held))]
            held[number] = block = read() if block is None else block
        return block

    def kept(self, frame: int) -> NDArray[np.bool_] | None:
        """Return (voxel,) which of all voxels of a frame are here; None where all are."""
        if self._still is None and self._moving is None:
            return None
        number = self._number(frame)
        return self._kept(self._read_whole(number), frame - self._hulls[number].start, frame)

    def _kept(self, whole: VoxelRuns, inside: int, frame: int) -> NDArray[np.bool_]:
        """Return (voxel,) which voxels of a frame, by its place in some hulls, are of no thing."""
        number = voxel_numbers(take_frame(whole, inside))
        kept = np.ones(len(number), np.bool_) if self._still is None else ~self._still[number]
        if self._moving is not None:
            kept &= ~are_of(number, self._moving, frame - self.start)
        return kept

    def _kept_of_block(self, number: int, whole: VoxelRuns) -> NDArray[np.bool_]:
        first = self._hulls[number].start
        return np.concatenate([self._kept(whole, n, first + n) for n in range(whole.frames)])

    def _read_hulls(self, number: int) -> VoxelRuns:
        whole = self._read_whole(number)
        if self._still is None and self._moving is None:
            return whole
        return leave_out(whole, self._kept_of_block(number, whole))

    def _read_whole(self, number: int) -> VoxelRuns:
        return VoxelRuns(**read_block(self._place, self._hulls[number]), shape=self.grid.shape)

    def _read_colors(self, number: int, runs: VoxelRuns) -> dict[str, NDArray]:
        colors = read_block(self._place, self._colors[number])
        if self._still is not None or self._moving is not None:
            kept = self._kept_of_block(number, self._read_whole(number))
            colors = _only(colors, kept)
        return {**colors, "voxels": np.concatenate([[0], np.cumsum(count_voxels(runs))])}


def _only(colors: dict[str, NDArray], kept: NDArray[np.bool_]) -> dict[str, NDArray]:
    """Return the colors of the voxels of a block that are kept."""
    is_surface, offset = colors["is_surface"], colors["offset"]
    own = kept[is_surface]
    before = np.concatenate([[0], np.cumsum(own)])
    return {
        "is_surface": is_surface[kept],
        "color": colors["color"][own],
        "camera": colors["camera"][own],
        "offset": before[offset],
    }


class HullFrames(Sequence[VoxelRuns]):
    """The hulls of a take, a single frame each, read when they are asked for."""

    def __init__(self, frames: VoxelFrames) -> None:
        """Go by the frames of a take."""
        self._frames = frames

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    def __getitem__(self, frame: Any) -> Any:
        """Return the hull of a frame."""
        return self._frames.hull(frame)
