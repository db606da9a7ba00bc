"""Stage: find what is not the performer: a chair, a lamp, a sword, a fan, another dancer.

What was brought in with the performer is in no background, and its voxels are in every hull. What
stands still is told by two signs together: it keeps its place all through the take, and in some
frames it is a piece apart from what moves most, which is the performer. So the core of a performer
who stays in place is none, for it is one with what moves. What is held is told where it is longer
than any part of a body that is as thin, or hangs by less of itself (`regions.held`); and another
body where the two are apart in every frame (`regions.others`). The stages after coloring leave
these voxels out; in the archive they belong to no segment.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from storage import open_archive
from storage.blocks import Block, Written, write_block
from storage.formats.capture.capture import capture_of
from storage.formats.capture.initial import read_initial
from tasks.capture.films import frames_all_over, grid_of
from tasks.engine.threads import side_by_side
from tasks.geometry.left_out import are_of, leave_out
from tasks.geometry.voxels import (
    VoxelGrid,
    VoxelRuns,
    decode_runs,
    encode_runs,
    join_runs,
    voxel_centers,
    voxel_index,
    voxel_numbers,
)
from tasks.reconstruction.regions.held import find_held
from tasks.reconstruction.regions.others import find_others
from tasks.reconstruction.regions.pieces import pieces_of_runs
from tasks.reconstruction.voxel_frames import VoxelFrames

_LOOKED_AT = 48
"""How many frames all over a take are looked at, at most [frames]. Chosen, not measured."""

_CELL_M = 0.03
"""Edge of the cells by which pieces are told apart [m]. What is nearer than that is one."""

_STAYS = 0.9
"""In how many frames a voxel is occupied that stays [share]. Silhouettes flicker."""

_STILL = 0.7
"""How much of the take the voxels of a thing are occupied, in the mean [share]. Its surface
flickers, and where the performer hides it from a camera it is larger; a dancer has .2."""

_APART = 0.1
"""In how many of the frames a thing is apart from the performer, at least [share]."""

_LEAST_APART = 3
"""In how many frames at least [frames]."""

_OF_PIECE = 0.3
"""In how many of the frames in which a thing is apart a voxel is of it [share]."""

_LEAST_M3 = 0.0005
"""How large a thing is at least [m³]. Half a liter; what is smaller takes nothing from a limb."""

_EVERY_LOOKED_AT = 3
"""In every which of these frames it is asked whether there are two bodies [frames]."""

_LOOKED_AT_FOR_HELD = 16
"""In how many frames all over a take it is looked for what is held, at most [frames]. Where there
is nothing a frame takes 30 ms; chosen, not measured."""

_LEAST_CLEAR = 3
"""In how many of these frames at least something is surely held, where it is [frames]. Chosen, not
measured."""

_RIM_M = 0.06
"""How far around what stands still nothing is held [m]. Its silhouettes flicker, and where the
performer hides it from a camera it is larger. Chosen, not measured."""

_PERFORMER_M3 = 0.006
"""How large a piece is at least that may be the performer [m³]. As for `doctor`."""


HullOf = Callable[[int], VoxelRuns]
"""Gives the hull of a frame, a single frame."""


def find_still_things(hulls: Sequence[VoxelRuns], grid: VoxelGrid) -> VoxelRuns:
    """Return the voxels of what stands still beside a performer, as runs of one frame.

    Parameters
    ----------
    hulls
        Of some frames all over a take, a single frame each.
    grid
        Their grid.
    """
    size = int(np.prod(grid.shape))
    none = np.zeros(0, np.uint32), np.zeros(0, np.uint16)
    nothing = VoxelRuns(*none, np.zeros(2, np.int64), grid.shape)
    numbers = [voxel_numbers(hull) for hull in hulls]
    if sum(len(own) > 0 for own in numbers) < _LEAST_APART:
        return nothing
    count = np.zeros(size, np.uint16)
    for own in numbers:
        count[own] += 1
    if (count >= _STAYS * len(hulls)).sum() * grid.voxel_m**3 < _LEAST_M3:
        return nothing
    votes = np.zeros(size, np.uint16)
    for hull, own in zip(hulls, numbers, strict=True):
        if len(own):
            is_still = _in_still_pieces(hull, count[own] / len(hulls), grid)
            votes[own[is_still]] += 1
    return encode_runs(_extent(votes.reshape(grid.shape), len(hulls), grid)[None])


def _in_still_pieces(
    hull: VoxelRuns, stays: NDArray[np.float64], grid: VoxelGrid
) -> NDArray[np.bool_]:
    """Return which voxels of a frame are of still pieces, beside the one that moves most.

    `stays` is (voxel,) the share of frames in which each voxel is occupied.
    """
    piece_of_run = pieces_of_runs(hull, max(1, round(_CELL_M / grid.voxel_m)))
    piece = np.repeat(piece_of_run, hull.length)
    size = np.bincount(piece)
    stay = np.bincount(piece, weights=stays) / np.maximum(size, 1)
    large = size * grid.voxel_m**3
    may_be = np.flatnonzero(large >= _PERFORMER_M3)
    if not len(may_be):
        return np.zeros(len(piece), np.bool_)
    still = (stay > _STILL) & (large >= _LEAST_M3 / 2)
    still[min(may_be, key=lambda number: (stay[number], -size[number]))] = False
    return still[piece]


def _extent(votes: NDArray[np.uint16], frames: int, grid: VoxelGrid) -> NDArray[np.bool_]:
    """Return (x, y, z) the voxels of things, by how often each was of a still piece."""
    least = max(_LEAST_APART, _APART * frames)
    seen: NDArray[Any] = np.asarray(
        cc3d.connected_components((votes >= least).astype(np.uint8), connectivity=26)
    )
    found = np.zeros(votes.shape, np.bool_)
    for number in range(1, int(seen.max()) + 1):
        own = seen == number
        own &= votes >= _OF_PIECE * votes[own].max()
        if own.sum() * grid.voxel_m**3 >= _LEAST_M3:
            found |= own
    return found


def describe_still_things(things: VoxelRuns, grid: VoxelGrid) -> tuple[str, ...]:
    """Return a sentence on what stands still beside the performer; none where nothing does."""
    if not len(things.start):
        return ()
    point = voxel_centers(grid, voxel_index(things, 0))
    low, high = point.min(axis=0), point.max(axis=0)
    middle = (low + high) / 2
    return (
        f"Something that is not the performer stands still at x = {middle[0]:.2f}, z = "
        f"{middle[2]:.2f} m, up to {high[1]:.2f} m high ({1e3 * len(point) * grid.voxel_m**3:.0f} "
        "liters): it is left out of the pose, and its voxels belong to no segment.",
    )


def find_held_things(
    hull_of: HullOf, frames: int, grid: VoxelGrid
) -> tuple[VoxelRuns | None, NDArray[np.bool_], tuple[str, ...]]:
    """Return the voxels of what is held in each frame, and a sentence; None where nothing is.

    And (time,) in which frames it hides the hand that holds it.

    Parameters
    ----------
    hull_of
        Gives the hull of a frame, a single frame.
    frames
        How many there are.
    grid
        Their grid.
    """
    some = frames_all_over(frames, _LOOKED_AT_FOR_HELD)
    clear = side_by_side(lambda frame: find_held(hull_of(frame), grid).is_clear, some)
    if sum(clear) < _LEAST_CLEAR:
        return None, np.zeros(frames, np.bool_), ()

    def held_in(frame: int) -> tuple[VoxelRuns, bool]:
        hull = hull_of(frame)
        found = find_held(hull, grid, known=True)
        return leave_out(hull, found.is_held), found.hides_hand

    runs, hides = zip(*side_by_side(held_in, range(frames)), strict=True)
    held, hidden = join_runs(runs), np.array(hides)
    count = int((np.diff(held.offset) > 0).sum())
    if count > 2 * hidden.sum():
        hidden &= False  # a rod, whose hand is seen
    where = f" In {hidden.sum()} of them the hand that holds it is a guess." if hidden.any() else ""
    return held, hidden, (
        "Something is held that is no part of a body, long and thin, or flat: it was told in "
        f"{count} of {frames} frames, is left out of the pose there, and its voxels belong to no "
        f"segment.{where}",
    )  # fmt: skip


def _without(
    hull_of: HullOf, is_out: Callable[[NDArray[np.integer], int], NDArray[np.bool_]]
) -> HullOf:
    """Return what gives hulls without those voxels, by number and frame, that are out."""

    def rest(frame: int) -> VoxelRuns:
        hull = hull_of(frame)
        return leave_out(hull, ~is_out(voxel_numbers(hull), frame))

    return rest


def find_still_take(
    archive: str, capture: str, digest: str, hulls: Sequence[Block], into: str
) -> Written:
    """Write the voxels of what stands still beside the performer of a take as a block.

    Parameters
    ----------
    archive, capture, digest, into
        As for `carve_block`.
    hulls
        What `carve_block` wrote, in the order of the frames.

    Returns
    -------
    Written
        The arrays are `start` and `length` of runs of voxels, in the order of one frame; and where
        something is held, or another body moves, `moving_start`, `moving_length` and
        `moving_offset` of its runs in each frame. `unexplained` (time,) tells where another body
        cannot be told from the performer's, or a hand from what it holds.
    """
    begun = time.monotonic()
    place, source = open_archive(archive).place, capture_of(capture, digest)
    frames = VoxelFrames(place, grid_of(source), hulls)
    grid, count = frames.grid, len(frames)
    some = frames_all_over(count, _LOOKED_AT)
    things = find_still_things([frames.hull(frame) for frame in some], grid)
    arrays = {"start": things.start, "length": things.length}
    notes = describe_still_things(things, grid)
    rest: HullOf = frames.hull
    still = decode_runs(things, 0)
    if len(things.start):
        rest = _without(rest, lambda number, _: still.ravel()[number])
    given = read_initial(source.initial) if source.initial else None
    at = None if given is None or (given.frame or 0) >= count else (given.frame or 0)
    others, said = find_others(
        rest, count, grid, some[::_EVERY_LOOKED_AT],
        None if given is None or at is None else (at, given.position),
    )  # fmt: skip
    notes = (*notes, *said)
    two = others is None and len(said) > 0
    if others is not None:
        rest = _without(rest, lambda number, frame: are_of(number, others, frame))
    if len(things.start):  # the rim of what stands flickers, and is no rod
        steps = max(1, round(_RIM_M / grid.voxel_m))
        near: Any = ndimage.binary_dilation(still, iterations=steps)
        rest = _without(rest, lambda number, _: near.ravel()[number])
    held, hidden, said = find_held_things(rest, count, grid)
    arrays["unexplained"] = hidden | two
    moving = [each for each in (others, held) if each is not None]
    if moving:
        both = join_runs(
            [
                leave_out(hull, np.any([are_of(own, each, frame) for each in moving], axis=0))
                for frame, hull in enumerate(map(frames.hull, range(count)))
                for own in [voxel_numbers(hull)]
            ]
        )
        arrays |= {f"moving_{name}": getattr(both, name) for name in ("start", "length", "offset")}
    return write_block(place, into, (0, count), arrays, begun, notes=(*notes, *said))
