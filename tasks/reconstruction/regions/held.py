"""Find what is held, in a hull: a sword, a staff, an umbrella, an open fan.

No part of a body is as thin as a rod over the length of one, and no sheet of cloth hangs by as
little of itself as a fan from a hand. Where such a thing was seen, what else is large and hangs by
a thin neck above the floor is it, too: the hull of a fan that few cameras see edgewise is thick.
"""

from dataclasses import dataclass
from typing import Any

import cc3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tasks.geometry.voxels import VoxelGrid, VoxelRuns, padded_crop, voxel_index

_THICK_M = 0.05
"""How thick a rod or a sheet is at most, and a body at least [m]. The blade of a sword is 3 cm in a
hull; the wrists of children are thinner than this, and shorter than a rod."""

_FINE_M = 0.02
"""How large voxels are at most by which a thing is told [m]. Of larger ones arms are thin, too."""

_WIDE_M = 0.05
"""How wide a rod is at most, as a strip that is as wide everywhere [m]. Of a sword .03 to .04, of
sleeves and skirts .06 to .3 in rendered captures."""

_HAND_M = 0.22
"""How far from the body a rod begins where it touches one [m]. A hand is as thin as a rod, and is
left to the body."""

_LEAST_M = 0.1
"""How long a rod is at least, beyond the hand [m]. The stick of an umbrella is .2."""

_CLEAR_M = 0.4
"""How long a rod is at least that is surely one [m]. A sword of 0.75 m is .5 to .7 beyond the hand;
sleeves, arms and noise have .3 at most in rendered captures without a thing."""

_SHEET_M = 0.35
"""How long a sheet is at least [m]. A fan of 0.6 m is .5."""

_SHEET_M2 = 0.03
"""How large a sheet is at least that is surely one, as if it were 5 cm thick [m²]. A fan of 0.14 m²
is .03 to .07."""

_NECK, _NECK_M = 0.05, 0.2
"""How much of a sheet touches the body at most [share of its voxels], and how far that goes [m]. Of
a fan it is .02 and .09 at most; of sleeves .09 and .16 to .34."""

_HEAVY_M3 = 0.003
"""How large what is thick is at least where it is held [m³]. A forearm has 2 liters."""

_HEAVY_NECK = 0.03
"""How much of it touches the body then at most [share of its voxels]. Of a fan, with the hand and
the thin edges of a sleeve, .01."""

_FLOOR_M = 0.15
"""How far above the lowest voxel what is held ends at least [m]. A foot does not."""

Marks = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Held:
    """What is held in a frame."""

    is_held: NDArray[np.bool_]
    """(voxel,) which voxels are of it."""
    is_clear: bool = False
    """Whether it is surely something held."""
    hides_hand: bool = False
    """Whether it is flat or thick where it may be held, so that the hand is a guess."""


def find_held(hull: VoxelRuns, grid: VoxelGrid, *, known: bool = False) -> Held:
    """Return what is held in a frame.

    Parameters
    ----------
    hull
        Of a single frame.
    grid
        Its grid.
    known
        Whether something is held in the take. If not, only what is surely held is returned.
    """
    if grid.voxel_m > _FINE_M:
        return Held(np.zeros(int(hull.length.sum()), np.bool_))
    steps = max(1, round(_THICK_M / 2.0 / grid.voxel_m))
    crop, begin = padded_crop(hull, 0, margin=2 * steps + 1)
    nothing = Held(np.zeros(int(hull.length.sum(dtype=np.int64)), np.bool_))
    thick, thin = _thick_and_thin(crop, steps)
    least = (_LEAST_M if known else _SHEET_M) / grid.voxel_m
    piece, found = _long_pieces(thin, least) if _may_be_long(thin, least) else (thin, [])
    if not (len(found) or known) or not thick.any():
        return nothing
    index = voxel_index(hull, 0)
    of: Any = cc3d.connected_components(thick, connectivity=26)
    size = np.bincount(of.ravel())
    size[0] = 0
    body = (of == size.argmax()).view(np.uint8)
    beside = _grown(body, steps + 1)
    held, flat, is_clear = np.zeros_like(crop), np.zeros_like(crop), False
    for number, box in found:
        own = np.argwhere(piece[box] == number) + [s.start for s in box]
        is_thing, clear, is_flat = _judge_thin(own, beside[tuple(own.T)] > 0, grid.voxel_m)
        (flat if is_flat else held)[tuple(own[is_thing].T)] = 1
        is_clear |= clear
    if held.any() or flat.any():
        carried = _carried(crop, held | flat, body)
        is_clear |= _is_heavy(carried > 0, crop, grid.voxel_m)
        held |= carried
    if known:
        hanging = _hanging(crop, body, beside, steps, grid.voxel_m)
        flat |= hanging & _grown(hanging & thick, 2 * steps)  # the neck is a hand
    elif not is_clear:
        return nothing
    held |= flat
    at_hand = KDTree(np.argwhere(body)[::10]).query(np.argwhere(flat)[::10])[0] * grid.voxel_m
    hides_hand = bool((at_hand < _HAND_M).any())
    return Held(held[tuple((index - begin).T)] > 0, is_clear, hides_hand)


def _long_pieces(marks: Marks, least: float) -> tuple[Any, list[tuple[int, Any]]]:
    """Return the pieces of what is marked, and number and box of those so long, in voxels."""
    piece: Any = cc3d.connected_components(marks, connectivity=26)
    if not piece.any():
        return piece, []
    boxes = cc3d.statistics(piece)["bounding_boxes"][1:]
    return piece, [
        (n, box)
        for n, box in enumerate(boxes, 1)
        if np.hypot.reduce([float(s.stop - s.start) for s in box]) > least
    ]


def _judge_thin(
    own: NDArray[np.int64], touches: NDArray[np.bool_], voxel_m: float
) -> tuple[NDArray[np.bool_], bool, bool]:
    """Return which voxels (voxel, 3) of a thin piece are of a thing; whether clear, and flat."""
    nothing = np.zeros(len(own), np.bool_)
    length_m, width_m, _ = _sides(own, voxel_m)
    area_m2 = len(own) * voxel_m**3 / _WIDE_M
    if width_m > _WIDE_M and length_m > _SHEET_M and _is_neck(own[touches], len(own), voxel_m):
        return ~nothing, area_m2 > _SHEET_M2, True
    far = ~nothing
    if touches.any():
        far = KDTree(own[touches]).query(own)[0] * voxel_m > _HAND_M
    if far.sum() < 3:
        return nothing, False, False
    length_m, width_m, axis = _sides(own[far], voxel_m)
    if length_m < _LEAST_M or width_m > _WIDE_M:
        return nothing, False, False
    away = own - own[far].mean(axis=0)
    off = np.linalg.norm(away - np.outer(away @ axis, axis), axis=1) * voxel_m
    return far | (off < _WIDE_M / 2.0), length_m > _CLEAR_M, False


def _sides(own: NDArray[np.int64], voxel_m: float) -> tuple[float, float, NDArray[np.float64]]:
    """Return how long voxels (voxel, 3) are, how wide a strip like them is, and the long axis."""
    away = own - own.mean(axis=0)
    spread, axes = np.linalg.eigh(away.T @ away / len(away))
    length = float(np.ptp(away @ axes[:, 2]))
    return length * voxel_m, float(np.sqrt(12.0 * max(spread[1], 0.0))) * voxel_m, axes[:, 2]


def _is_neck(touching: NDArray[np.int64], voxels: int, voxel_m: float) -> bool:
    """Return whether the voxels (touching, 3) that touch the body are few, and together."""
    if not len(touching):
        return True
    far = float(np.linalg.norm(np.ptp(touching, axis=0))) * voxel_m
    return len(touching) <= _NECK * voxels and far <= _NECK_M


def _hanging(crop: Marks, body: Marks, beside: Marks, steps: int, voxel_m: float) -> Marks:
    """Return what is large, hangs on the body by a thin neck, and ends above the floor."""
    rest: Any = cc3d.connected_components(crop & ~_grown(body, steps), connectivity=26)
    size = np.bincount(rest.ravel())
    found = np.zeros_like(crop)
    for number in np.flatnonzero(size * voxel_m**3 > _HEAVY_M3):
        own = rest == number
        if number and (beside[own] > 0).mean() <= _HEAVY_NECK:
            found |= own & _is_heavy(own, crop, voxel_m)
    return found


def _is_heavy(own: NDArray[np.bool_], crop: Marks, voxel_m: float) -> bool:
    """Return whether a part of a hull is larger than a forearm, and ends above the floor."""
    if own.sum() * voxel_m**3 <= _HEAVY_M3:
        return False
    lowest = [np.flatnonzero(marks.any(axis=(0, 2)))[0] for marks in (own, crop)]
    return bool((lowest[0] - lowest[1]) * voxel_m > _FLOOR_M)


def _carried(crop: Marks, held: Marks, body: Marks) -> Marks:
    """Return what hangs together with the body by held things alone."""
    rest: Any = cc3d.connected_components(crop & ~held, connectivity=26)
    of_body = np.unique(rest[body > 0])
    beside = np.unique(rest[_grown(held, 1) > 0])
    return np.isin(rest, np.setdiff1d(beside, np.append(of_body, 0))).astype(np.uint8)


def _may_be_long(marks: Marks, least: float) -> bool:
    """Return whether a piece may be so long, in voxels: a fifth of the work of finding pieces.

    What hangs together by voxels hangs together by blocks of eight of them.
    """
    whole = np.zeros([side + side % 2 for side in marks.shape], np.uint8)
    whole[tuple(map(slice, marks.shape))] = marks
    blocks = whole[0::2] | whole[1::2]
    blocks = blocks[:, 0::2] | blocks[:, 1::2]
    blocks = blocks[:, :, 0::2] | blocks[:, :, 1::2]
    return len(_long_pieces(blocks, least / 2.0)[1]) > 0


def _thick_and_thin(crop: Marks, steps: int) -> tuple[Marks, Marks]:
    """Return where a ball with a radius of some voxels fits into a crop, and what is off that."""
    every = (1 << crop.size) - 1
    bits = _as_bits(crop)
    thick = every ^ _grow(every ^ bits, crop.shape, steps)
    thick = _grow(thick, crop.shape, steps) & bits
    thin = bits & ~_grow(thick, crop.shape, steps)
    return _of_bits(thick, crop.shape), _of_bits(thin, crop.shape)


def _grown(marks: Marks, steps: int) -> Marks:
    """Return what is marked, wider by a ball with a radius of some voxels; as `_grow`."""
    return _of_bits(_grow(_as_bits(marks), marks.shape, steps), marks.shape)


def _grow(bits: int, shape: tuple[int, ...], steps: int) -> int:
    """Return bits of marks with so many neighbors of each: a cross, then a cube, in turn.

    A bit's neighbor beyond an end of its line is the first one of the next line. So the outermost
    voxels may be wrong, unless all of them, as far as a ball reaches, are marked, or none.
    """
    every = (1 << shape[0] * shape[1] * shape[2]) - 1
    for step in range(steps):
        grown = bits
        for far in (shape[1] * shape[2], shape[2], 1):
            source = bits if step % 2 == 0 else grown
            grown |= source << far | source >> far
        bits = grown & every
    return bits


def _as_bits(marks: Marks) -> int:
    """Return marks as the bits of one number, for Python works on 30 of them at a time."""
    return int.from_bytes(np.packbits(marks).tobytes(), "big") >> -marks.size % 8


def _of_bits(bits: int, shape: tuple[int, ...]) -> Marks:
    """Return the marks whose bits a number has."""
    size = shape[0] * shape[1] * shape[2]
    spread = (bits << -size % 8).to_bytes(-(-size // 8), "big")
    return np.unpackbits(np.frombuffer(spread, np.uint8), count=size).reshape(shape)
