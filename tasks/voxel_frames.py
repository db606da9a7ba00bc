"""The hulls and surface colors of a take, frame by frame, from the blocks of its stages.

No stage and no arithmetic: the part of a store function that the stages after coloring share.
"""

import threading
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.blocks import read_block
from storage.places import Place
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, count_voxels, take_frame, voxel_index

_MOST_HELD = 2  # blocks: neighbors in time may be of two

_Block = tuple[VoxelRuns, dict[str, NDArray]]


class VoxelFrames:
    """A take's frames, read when they are asked for; neighbors are cheap, two blocks are held."""

    def __init__(
        self,
        place: Place,
        grid: VoxelGrid,
        hulls: Sequence[dict[str, Any]],
        colors: Sequence[dict[str, Any]],
    ) -> None:
        """Open what `carve_block` and `color_block` wrote, in the order of the frames."""
        self.grid = grid
        self.start, self.end = hulls[0]["start"], hulls[-1]["end"]
        self._ends = np.array([block["end"] for block in hulls])
        self._hulls, self._colors = hulls, colors
        self._place = place
        self._held: dict[int, _Block] = {}  # the one asked for last is the last
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.end - self.start

    def hull(self, frame: int) -> VoxelRuns:
        """Return the hull of a frame, as runs of a single frame."""
        runs, _, inside = self._find(frame)
        return take_frame(runs, inside)

    def index(self, frame: int) -> NDArray[np.int32]:
        """Return (voxel, 3) the index of each voxel of a frame, in order."""
        runs, _, inside = self._find(frame)
        return voxel_index(runs, inside)

    def surface(self, frame: int) -> tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.uint8]]:
        """Return which voxels of a frame are on the surface, and these voxels' color and camera.

        Returns
        -------
        is_surface : (voxel,) bool
        color : (surface voxel, 3) uint8
            RGB.
        camera : (surface voxel,) uint8
            255 where no camera sees the voxel.
        """
        _, colors, inside = self._find(frame)
        voxels = slice(*colors["voxels"][inside : inside + 2])
        surface = slice(*colors["offset"][inside : inside + 2])
        return colors["is_surface"][voxels], colors["color"][surface], colors["camera"][surface]

    def hulls(self, first: int, end: int) -> Iterator[VoxelRuns]:
        """Yield the hulls of the frames from `first` to before `end`."""
        return (self.hull(frame) for frame in range(first, end))

    def _find(self, frame: int) -> tuple[VoxelRuns, dict[str, NDArray], int]:
        """Return the block of a frame, and the frame's place in it."""
        if not self.start <= frame < self.end:
            raise IndexError(f"frame {frame} is not one of {self.start} to {self.end - 1}")
        number = int(np.searchsorted(self._ends, frame, side="right"))
        with self._lock:  # so that threads read a block once
            block = self._held.pop(number, None)
            while block is None and len(self._held) >= _MOST_HELD:
                del self._held[next(iter(self._held))]
            self._held[number] = block = block or self._read_block(number)
        runs, colors = block
        return runs, colors, frame - self._hulls[number]["start"]

    def _read_block(self, number: int) -> _Block:
        runs = VoxelRuns(**read_block(self._place, self._hulls[number]), shape=self.grid.shape)
        colors = read_block(self._place, self._colors[number])
        return runs, {**colors, "voxels": np.concatenate([[0], np.cumsum(count_voxels(runs))])}
