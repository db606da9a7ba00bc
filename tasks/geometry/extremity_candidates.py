"""Where a hand or the face could be in one frame: skin-colored lumps and ends of the surface.

The surface is gathered into cells of one eightieth of the stature. A lump is a place around
which more skin is gathered than around its neighbors, in a ball of a hand's (or face's) size;
an end is a place farther along the surface from the trunk than all around it (the geodesic
extrema of Plagemann et al. 2010). Ends find hands in gloves, lumps find hands on the body.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tasks.geometry.skin import NO_CAMERA, SkinModel, SurfaceFrame, skin_ratio

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CandidateSettings:
    """Everything that changes where hands and face could be; lengths in statures."""

    cell: float = 0.0125
    """Edge of a cell: 2 cm, a third of a hand's width."""

    hand_radius: float = 0.04
    """Ball that holds most of a hand, 7 cm."""

    face_radius: float = 0.06
    """Ball that holds a face, 10 cm."""

    apart: float = 0.045
    """Least distance of two candidates: half a hand's length."""

    least_mass: float = 0.12
    """Skin in the ball below which there is no lump, as a share of the initial hand's."""

    least_hand: float = 0.2
    """Least skin of a hand, as a share of the face's: of twelve generated takes the least, of
    hands half of which the hull lacks; whole hands have half."""

    hands: int = 8
    """Most lumps a frame."""

    faces: int = 4
    """Most lumps of a face's size a frame."""

    ends: int = 8
    """Most ends a frame: head, hands, feet, and as many again of elbows and cloth."""

    end_reach: float = 0.07
    """How far from an end what a hand's place is the mean of reaches: two thirds of its length."""

    head_ball: float = 0.1
    """Ball around a face that holds the front half of the head, hair and all."""

    end_least: float = 0.15
    """Least way from the trunk's middle to an end."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Where hands and face could be in one frame."""

    hand: Floats
    """(candidate, 3) metres."""

    hand_skin: Floats
    """(candidate,) skin around it, 1: as much as around a hand of the initial model."""

    hand_end: NDArray[np.bool_]
    """(candidate,) True at an end of the surface."""

    face: Floats
    """(face candidate, 3) metres."""

    face_skin: Floats
    """(face candidate,) skin around it, 1: as much as in the initial model."""

    face_front: Floats
    """(face candidate, 3) from the middle of the surface around it to the skin in it, in
    statures: a face is in front of its head."""


@dataclass(frozen=True)
class ReferenceMasses:
    """Skin around hands and face in the initial model: sums of clipped ratios of voxels."""

    hand: float
    face: float


def measure_references(
    frames: list[SurfaceFrame],
    model: SkinModel,
    hands: Floats,
    face: Floats,
    stature_m: float,
    settings: CandidateSettings,
) -> ReferenceMasses:
    """Return the skin around the two hands (2, 3) and the face (3,), the median over frames."""
    masses: list[tuple[float, float]] = []
    for frame in frames:
        found = []
        for table, radius, near in (
            (0, settings.hand_radius, hands),
            (1, settings.face_radius, face[None]),
        ):
            ratio = _ratios(frame, model)[table]
            sums = []
            for place in near:
                lump = place
                for _ in range(3):  # climbs onto the lump, as candidates do
                    close = np.linalg.norm(frame.center - lump, axis=1) < radius * stature_m
                    hot = np.maximum(ratio[close], 0.0)
                    if hot.sum() > 0:
                        lump = hot @ frame.center[close] / hot.sum()
                close = np.linalg.norm(frame.center - lump, axis=1) < radius * stature_m
                sums.append(ratio[close].sum())
            found.append(float(np.mean(sums)))
        masses.append((found[0], found[1]))
    hand_mass, face_mass = np.maximum(np.median(masses, axis=0), 1.0)
    hand_mass = max(hand_mass, settings.least_hand * face_mass)
    return ReferenceMasses(float(hand_mass), float(face_mass))


def find_candidates(
    frame: SurfaceFrame,
    model: SkinModel,
    references: ReferenceMasses,
    stature_m: float,
    settings: CandidateSettings | None = None,
) -> Candidates:
    """Return where hands and face could be in a frame.

    Parameters
    ----------
    frame
        The colored surface; it may be empty.
    model
        What color skin has.
    references
        How much of it a hand and a face show.
    stature_m
        The performer's height.
    settings
        Sizes and numbers of candidates.
    """
    settings = settings or CandidateSettings()
    if not len(frame.center):
        none = np.empty((0, 3))
        return Candidates(none, none[:, 0], np.empty(0, np.bool_), none, none[:, 0], none)
    cells = _gather(frame, model, settings.cell * stature_m)
    lumps, lump_skin = _lumps(
        cells, 0, settings.hand_radius, settings.hands, references.hand, stature_m, settings
    )
    faces, face_skin = _lumps(
        cells, 1, settings.face_radius, settings.faces, references.face, stature_m, settings
    )
    ends = _ends(cells, stature_m, settings)
    is_end = np.zeros(len(lumps), np.bool_)
    alone = np.ones(len(ends), np.bool_)
    if len(lumps) and len(ends):
        near = np.linalg.norm(lumps[:, None] - ends[None], axis=2) < settings.apart * stature_m
        is_end, alone = near.any(axis=1), ~near.any(axis=0)
    ends = ends[alone]
    end_skin = _mass_at(cells, 0, ends, settings.hand_radius * stature_m) / references.hand
    return Candidates(
        np.concatenate([lumps, ends]),
        np.concatenate([lump_skin, end_skin]),
        np.concatenate([is_end, np.ones(len(ends), np.bool_)]),
        faces,
        face_skin,
        (faces - _middles(cells, faces, settings.head_ball * stature_m)) / stature_m,
    )


@dataclass(frozen=True, eq=False)
class _Cells:
    """The surface, gathered into cells."""

    place: NDArray[np.int64]
    """(cell, 3) in `number`, which has a rim of empty cells."""
    number: NDArray[np.int32]
    """(x, y, z) which cell, -1: none."""
    size_m: float
    center: Floats
    """(cell, 3) mean of its voxels."""
    count: NDArray[np.int64]
    """(cell,) how many voxels."""
    mass: Floats
    """(2, cell) sums of the clipped ratios of hand and face."""
    hot: Floats
    """(2, cell) sums of the ratios above 0."""
    hot_center: Floats
    """(2, cell, 3) mean of the voxels, each weighed with its ratio."""


_RIM = 6


def _ratios(frame: SurfaceFrame, model: SkinModel) -> Floats:
    """Return (2, voxel) ratios of hand and face, from -1 to 2; 0 where the color is borrowed."""
    ratio = np.stack(skin_ratio(model, frame.color)).astype(np.float64)
    return np.where(frame.camera != NO_CAMERA, np.clip(ratio, -1.0, 2.0), 0.0)


def _gather(frame: SurfaceFrame, model: SkinModel, size_m: float) -> _Cells:
    """Gather a frame's surface voxels into cells."""
    index = np.floor(frame.center / size_m).astype(np.int64)
    index -= index.min(axis=0) - _RIM
    shape = tuple(int(n) for n in index.max(axis=0) + _RIM + 1)
    flat = np.ravel_multi_index(tuple(index.T), shape)
    number = np.full(int(np.prod(shape)), -1, np.int32)
    number[flat] = 0
    kept = np.flatnonzero(number == 0)
    number[kept] = np.arange(len(kept), dtype=np.int32)
    cell = number[flat]
    ratio = _ratios(frame, model)
    hot = np.maximum(ratio, 0.0)

    def add(weight: Floats) -> Floats:
        return np.bincount(cell, weight, len(kept)).astype(np.float64)

    count = np.bincount(cell, minlength=len(kept))
    center = np.stack([add(frame.center[:, k]) for k in range(3)], axis=1) / count[:, None]
    hot_sum = np.stack([add(h) for h in hot])
    moments = np.stack(
        [np.stack([add(h * frame.center[:, k]) for k in range(3)], axis=1) for h in hot]
    )
    hot_center = np.where(
        hot_sum[..., None] > 0.0, moments / np.maximum(hot_sum, 1e-9)[..., None], center
    )
    return _Cells(
        np.stack(np.unravel_index(kept, shape), axis=1),
        number.reshape(shape),
        size_m,
        center,
        count,
        np.stack([add(r) for r in ratio]),
        hot_sum,
        hot_center,
    )


def _lumps(
    cells: _Cells,
    table: int,
    radius: float,
    most: int,
    reference: float,
    stature_m: float,
    settings: CandidateSettings,
) -> tuple[Floats, Floats]:
    """Return (lump, 3) places of most skin, the most first, and how much of the reference's."""
    radius_m, apart_m = radius * stature_m, settings.apart * stature_m
    seeds = np.flatnonzero(cells.hot[table] > 0.5)
    lumps = np.empty((0, 3))
    if not len(seeds):
        return lumps, np.empty(0)
    centers = cells.hot_center[table]
    mass, mean = np.empty(len(seeds)), np.empty((len(seeds), 3))
    ball = (cells.number, cells.place, centers, cells.mass[table], cells.hot[table])
    _sum_balls(*ball, (seeds, centers[seeds], radius_m, cells.size_m, mass, mean))
    chosen = []
    alive = mass > settings.least_mass * reference
    while alive.any() and len(chosen) < most:
        best = int(np.argmax(np.where(alive, mass, -np.inf)))
        chosen.append(best)
        alive &= np.linalg.norm(mean - mean[best], axis=1) > max(apart_m, 0.75 * radius_m)
    again, place = np.empty(len(chosen)), np.empty((len(chosen), 3))
    _sum_balls(*ball, (seeds[chosen], mean[chosen], radius_m, cells.size_m, again, place))
    return place, again / reference


def _mass_at(cells: _Cells, table: int, place: Floats, radius_m: float) -> Floats:
    """Return the skin in the balls around places."""
    apart = np.linalg.norm(cells.center[None] - place[:, None], axis=2)
    return (apart < radius_m) @ cells.mass[table]


def _middles(cells: _Cells, place: Floats, radius_m: float) -> Floats:
    """Return (place, 3) the middle of the surface in the balls around places."""
    near = np.linalg.norm(cells.center[None] - place[:, None], axis=2) < radius_m
    weight = near * cells.count
    return weight @ cells.center / np.maximum(weight.sum(axis=1), 1.0)[:, None]


def _ends(cells: _Cells, stature_m: float, settings: CandidateSettings) -> Floats:
    """Return (end, 3) places where the surface ends, the farthest first."""
    middle = np.median(cells.center, axis=0)
    root = int(np.argmin(np.linalg.norm(cells.center - middle, axis=1)))
    way = np.full(len(cells.place), np.inf)
    _spread(cells.number, cells.place, cells.center, root, way)
    peaks = np.empty(len(way), np.bool_)
    _mark_peaks(cells.number, cells.place, way, peaks)
    peaks &= way > settings.end_least * stature_m
    order = np.flatnonzero(peaks)[np.argsort(-way[peaks], kind="stable")]
    found: list[int] = []
    for cell in order:
        apart = np.linalg.norm(cells.center[found] - cells.center[cell], axis=1)
        if (apart > 2.0 * settings.apart * stature_m).all():
            found.append(int(cell))
        if len(found) == settings.ends:
            break
    reach = settings.end_reach * stature_m
    places = [
        cells.center[np.linalg.norm(cells.center - cells.center[cell], axis=1) < reach].mean(axis=0)
        for cell in found
    ]
    return np.array(places).reshape(-1, 3)


@njit(cache=True)
def _sum_balls(number: Any, place: Any, center: Any, mass: Any, hot: Any, wanted: Any) -> None:
    """Sum the mass of the cells in balls, and find the mean of what is hot in them.

    `wanted`: the cell each ball is at, its center, radius, size of a cell, and what is written:
    the masses and the means.
    """
    seeds, around, radius, size, total, mean = wanted
    reach = int(np.ceil(radius / size)) + 1
    for s in range(len(seeds)):
        x0, y0, z0 = place[seeds[s]]
        x0 += int(np.floor((around[s, 0] - center[seeds[s], 0]) / size + 0.5))
        y0 += int(np.floor((around[s, 1] - center[seeds[s], 1]) / size + 0.5))
        z0 += int(np.floor((around[s, 2] - center[seeds[s], 2]) / size + 0.5))
        total[s] = 0.0
        weight = 1e-12
        mx = my = mz = 0.0
        for x in range(max(x0 - reach, 0), min(x0 + reach + 1, number.shape[0])):
            for y in range(max(y0 - reach, 0), min(y0 + reach + 1, number.shape[1])):
                for z in range(max(z0 - reach, 0), min(z0 + reach + 1, number.shape[2])):
                    n = number[x, y, z]
                    if n < 0:
                        continue
                    dx = center[n, 0] - around[s, 0]
                    dy = center[n, 1] - around[s, 1]
                    dz = center[n, 2] - around[s, 2]
                    if dx * dx + dy * dy + dz * dz < radius * radius:
                        total[s] += mass[n]
                        weight += hot[n]
                        mx += hot[n] * center[n, 0]
                        my += hot[n] * center[n, 1]
                        mz += hot[n] * center[n, 2]
        if weight > 1e-9:
            mean[s, 0] = mx / weight
            mean[s, 1] = my / weight
            mean[s, 2] = mz / weight
        else:
            mean[s] = around[s]


@njit(cache=True)
def _spread(number: Any, place: Any, center: Any, root: Any, way: Any) -> None:
    """Write the length of the shortest way over neighboring cells from the root to each cell."""
    count = len(place)
    queue = np.empty(count, np.int32)
    waiting = np.zeros(count, np.bool_)
    queue[0] = root
    waiting[root] = True
    way[root] = 0.0
    first, length = 0, 1
    while length > 0:
        cell = queue[first]
        first = (first + 1) % count
        length -= 1
        waiting[cell] = False
        x0, y0, z0 = place[cell]
        for x in range(x0 - 1, x0 + 2):
            for y in range(y0 - 1, y0 + 2):
                for z in range(z0 - 1, z0 + 2):
                    n = number[x, y, z]
                    if n < 0 or n == cell:
                        continue
                    dx = center[n, 0] - center[cell, 0]
                    dy = center[n, 1] - center[cell, 1]
                    dz = center[n, 2] - center[cell, 2]
                    longer = way[cell] + np.sqrt(dx * dx + dy * dy + dz * dz)
                    if longer < way[n] - 1e-9:
                        way[n] = longer
                        if not waiting[n]:
                            waiting[n] = True
                            queue[(first + length) % count] = n
                            length += 1


@njit(cache=True)
def _mark_peaks(number: Any, place: Any, way: Any, peaks: Any) -> None:
    """Mark the cells that are reached and farther than each neighbor within two cells."""
    for cell in range(len(place)):
        peaks[cell] = np.isfinite(way[cell])
        x0, y0, z0 = place[cell]
        for x in range(x0 - 2, x0 + 3):
            for y in range(y0 - 2, y0 + 3):
                for z in range(z0 - 2, z0 + 3):
                    n = number[x, y, z]
                    if n >= 0 and np.isfinite(way[n]) and way[n] > way[cell]:
                        peaks[cell] = False
