"""Where a hand or the face could be in one frame: skin-colored lumps and ends of the surface.

The surface is gathered into cells of one eightieth of the stature. A lump is a place around
which more skin is gathered than around its neighbors, in a ball of a hand's or face's size. An end
is a place that is farther along the surface from the trunk than all places around it (the geodesic
extrema of Plagemann et al. 2010). Ends find hands in gloves, lumps find hands on the body.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.skin import SkinModel, SurfaceFrame
from tasks.body.extremities.cells import Cells, choose_apart, find_ends, gather_cells, sum_balls
from tasks.engine.kernels import njit
from tasks.engine.settings import Count, NotNegative, Positive, check_ranges

Floats = NDArray[np.float64]


LEAST_OWN = -1.0
"""The least that a voxel adds to the mass of a lump [nats]. Chosen by eye on the shared captures;
not measured."""

MOST_OWN = 2.0
"""The most that a voxel adds to the mass of a lump [nats]. Chosen by eye on the shared captures;
not measured."""

LUMPS_APART = 0.75
"""Least distance of two lumps, if it is more than the settings' [radii of a lump]. Chosen by eye on
the shared captures; not measured."""


@dataclass(frozen=True)
class CandidateSettings:
    """Everything that changes where hands and face could be; lengths in statures.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    cell: Positive = 0.0125
    """Edge of a cell [statures]. 2 cm, a third of a hand's width."""

    hand_radius: Positive = 0.04
    """Radius of the ball that holds most of a hand [statures]. 7 cm of 1.7 m."""

    face_radius: Positive = 0.06
    """Radius of the ball that holds a face [statures]. 10 cm of 1.7 m."""

    apart: Positive = 0.045
    """Least distance of two candidates [statures]. Half a hand's length."""

    least_mass: NotNegative = 0.12
    """Skin in the ball below which there is no lump [as of the initial hand or face]. Chosen by eye
    on the shared captures; not measured."""

    least_hand: NotNegative = 0.2
    """Least skin that the initial hand is taken to have [as of the face]. Of twelve generated takes
    the least, of hands half of which the hull lacks; whole hands have half."""

    least_seed: NotNegative = 0.01
    """Skin of a cell that lumps are looked for around [as of the initial hand or face]. Of the
    forty cells of a hand, one has more than twice that."""

    hands: Count = 8
    """Most lumps of a hand's size that are looked at in a frame. Chosen by eye on the shared
    captures; not measured."""

    faces: Count = 8
    """Most lumps of a face's size that are looked at in a frame. Bare hands and feet are four that
    may show more skin."""

    ends: Count = 8
    """Most ends that are looked at in a frame. Head, hands, feet, and as many again of elbows and
    cloth."""

    end_reach: Positive = 0.07
    """How far from an end the surface is whose middle is the hand's place [statures]. Two thirds of
    a hand's length."""

    head_ball: Positive = 0.1
    """Radius of the ball around a face that holds the front half of the head [statures]. Hair and
    all; chosen by eye on the shared captures, not measured."""

    end_least: NotNegative = 0.15
    """Least way along the surface from the trunk's middle to an end [statures]. Chosen by eye on
    the shared captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Where hands and face could be in one frame."""

    hand: Floats
    """(candidate, 3) metres."""

    hand_skin: Floats
    """(candidate,) skin around it; 1 is as much as around a hand of the initial model."""

    hand_end: NDArray[np.bool_]
    """(candidate,) True at an end of the surface."""

    face: Floats
    """(face candidate, 3) metres."""

    face_skin: Floats
    """(face candidate,) skin around it; 1 is as much as in the initial model."""

    face_front: Floats
    """(face candidate, 3) from the middle of the surface around it to its skin, statures. A face is
    in front of its head."""

    face_end: Floats
    """(face candidate,) distance to the nearest end of the surface, statures; infinite where there
    is none. The top of a head is an end."""

    face_bare: Floats
    """(face candidate,) how much lacks around it of the colors that the head has beside skin, 0 to
    1; 0 as long as nobody asked."""


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
    settings: CandidateSettings,
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
    if not len(frame.center):
        none = np.empty((0, 3))
        return Candidates(
            none, none[:, 0], np.empty(0, np.bool_), none, none[:, 0], none, none[:, 0], none[:, 0]
        )
    cells = gather_cells(frame.center, _ratios(frame, model), settings.cell * stature_m)
    _, lumps, lump_skin = _lumps(cells, 0, references.hand, stature_m, settings)
    near_face, faces, face_skin = _lumps(cells, 1, references.face, stature_m, settings)
    last = find_ends(
        cells, settings.end_least * stature_m, 2.0 * settings.apart * stature_m, settings.ends
    )
    to_end = np.linalg.norm(faces[:, None] - cells.center[last], axis=2).min(axis=1, initial=np.inf)
    weighed = (cells.center, cells.mass[0], cells.count)
    _, ends = sum_balls(cells, last, cells.center[last], settings.end_reach * stature_m, weighed)
    meets = np.linalg.norm(lumps[:, None] - ends[None], axis=2) < settings.apart * stature_m
    alone = ~meets.any(axis=0)
    ends, last = ends[alone], last[alone]
    end_skin, _ = sum_balls(cells, last, ends, settings.hand_radius * stature_m, weighed)
    _, heads = sum_balls(cells, near_face, faces, settings.head_ball * stature_m, weighed)
    return Candidates(
        np.concatenate([lumps, ends]),
        np.concatenate([lump_skin, end_skin / references.hand]),
        np.concatenate([meets.any(axis=1), np.ones(len(ends), np.bool_)]),
        faces,
        face_skin,
        (faces - heads) / stature_m,
        to_end / stature_m,
        np.zeros(len(faces)),
    )


def is_skin(frame: SurfaceFrame, model: SkinModel) -> NDArray[np.bool_]:
    """Return which voxels (voxel,) have rather the color of a hand or face than another."""
    return _ratios(frame, model).max(axis=0) > 0.0


def _ratios(frame: SurfaceFrame, model: SkinModel) -> Floats:
    """Return (2, voxel) the ratios of hand and face, bounded; 0 where the color is borrowed."""
    ratio = np.empty((2, len(frame.color)))
    _look_up(frame.color, frame.camera, model.hand, ratio[0])
    _look_up(frame.color, frame.camera, model.face, ratio[1])
    return ratio


def find_lumps(
    cells: Cells,
    table: int,
    reference: float,
    radius_m: float,
    apart_m: float,
    least: tuple[float, float, int],
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Return for each lump a cell near it, place and mass by the reference, the most mass first.

    Parameters
    ----------
    cells
        The surface.
    table
        Which of its sums.
    reference
        The mass of a whole one.
    radius_m, apart_m
        Of a lump, and the least distance of two.
    least
        Mass of a cell that lumps are looked for around and of a lump, by the reference, and how
        many lumps there are at most.
    """
    seeds = np.flatnonzero(cells.hot[table] > least[0] * reference)
    weighed = (cells.hot_center[table], cells.mass[table], cells.hot[table])
    mass, middle = sum_balls(cells, seeds, weighed[0][seeds], radius_m, weighed)
    large = np.flatnonzero(mass > least[1] * reference)
    chosen = large[choose_apart(middle[large], mass[large], apart_m, least[2])]
    mass, place = sum_balls(cells, seeds[chosen], middle[chosen], radius_m, weighed)
    return seeds[chosen], place, mass / reference


def _lumps(
    cells: Cells,
    table: int,
    reference: float,
    stature_m: float,
    settings: CandidateSettings,
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Return lumps of a hand's size and colors (table 0) or of a face's (1), as `find_lumps`."""
    radius = (settings.hand_radius, settings.face_radius)[table]
    most = (settings.hands, settings.faces)[table]
    apart_m = max(settings.apart, LUMPS_APART * radius) * stature_m
    least = (settings.least_seed, settings.least_mass, most)
    return find_lumps(cells, table, reference, radius * stature_m, apart_m, least)


@njit(cache=True, nogil=True)
def _look_up(color: Any, camera: Any, table: Any, ratio: Any) -> None:
    """Write the ratios of colors, within their limits."""
    for n in range(len(color)):
        own = table[color[n, 0] >> 2, color[n, 1] >> 2, color[n, 2] >> 2]
        ratio[n] = min(max(np.float64(own), LEAST_OWN), MOST_OWN) if camera[n] != NO_CAMERA else 0.0
