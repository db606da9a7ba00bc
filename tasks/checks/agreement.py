"""Whether the silhouettes of a capture agree with each other, with the cameras and the volume.

A visual hull shows, from each camera, all of the silhouette it was carved from, if the silhouettes
are of one performer and the cameras stand where the calibration says. The share of a silhouette
that the hull *explains* tells how far that holds; `tasks.checks.hulls.consistency` finds the
cameras that are inconsistent where it does not. Here it is said in words, and what is to be done.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.formats.reading import listed
from tasks.checks.bodies import judge_bodies
from tasks.checks.hulls.bounds import fitting_box, grid_corners, is_inside, main_parts
from tasks.checks.hulls.consistency import (
    Consistency,
    find_exchanged,
    find_inconsistent_cameras,
    least_explained,
    measure_consistency,
    share_explained,
    share_overlapped,
)
from tasks.checks.telling import By, blind_why, filled_fault
from tasks.engine.settings import Count, NotNegative, Positive, Share, check_ranges
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid

_LEAST_OUTSIDE = 0.002
"""Less of the hull outside the volume is not said [share]. A hand is some 0.006 of a body; the
hulls of three cameras reached 0.001 out of a volume that held the performer."""

_FILMED = 0.1
"""Of how much of the hull a camera that sees nobody must film the place to be a fault [share].
Chosen, not measured."""


@dataclass(frozen=True)
class AgreementSettings:
    """What is still agreement between cameras.

    "Explained" is the share of a silhouette that the hull covers. Measured on four rendered
    captures and a real one (`dancer8`), of the camera whose silhouette is explained worst: 0.92 to
    0.99 as they are; 0.85 and 0.54 at least where each camera is turned at random by 1 and 2 pixels
    of 320; 0.42 to 0.66 with a camera panned by 2 degrees.
    """

    consistent: Share = 0.85
    """Cameras of whose silhouettes so much is explained agree. The worst camera of the captures
    measured has 0.92, and 0.85 where all are turned by a pixel."""
    unexplained_ratio: Positive = 2.5
    """A camera is inconsistent when the hull of the others leaves so many times as much of its
    silhouette unexplained as of theirs [times]. Measured 3 with a camera turned by 5 degrees about
    its axis (`dancer8`), 1.7 with all cameras turned a little."""
    harmed_below: Share = 0.7
    """Where an inconsistent camera leaves less of another's silhouette explained, it is a fault;
    above, a note: the hull is a bit thin, or the camera sees something beside the performer. The
    value is between the 0.42 to 0.66 of a camera panned by 2 degrees and the 0.85 that agree."""
    mixed_up_below: Share = 0.5
    """Where no camera alone is inconsistent, less than this explained is a fault. Cameras that are
    all turned at random by 2 pixels have 0.54 at least."""
    most_of_picture: Share = 0.5
    """A silhouette that is more of the picture in half of the frames is a wrong background. Chosen
    as what no performer in a volume fills; not measured."""
    most_outside: Share = 0.02
    """More of the hull outside the volume is a fault, less a note. Feet cut off at 0.4 m are 0.05;
    an arm stretched out of it in one frame of 8 is 0.006."""
    margin_m: NotNegative = 0.1
    """Room left around the hulls of the few frames in a volume that is proposed. Chosen, not
    measured."""
    tallest_m: Positive = 2.6
    """A performer who would be higher, arms raised, was filmed by cameras in another unit. Above
    any dancer's reach, and below three feet for a metre; chosen, not measured."""
    late_frames: Positive = 0.75
    """From how many frames that a film is late by its silhouettes it is a fault [frames]. Measured
    errors are 0.12 where the performer moves, and 0.48 in 24 frames; `offset_s` mends it."""
    min_cameras: Count = 3
    """How many silhouettes make a hull. As `CarvingSettings.min_cameras`: fewer meet in more than a
    performer."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class Agreement:
    """What was found; the arrays are in the order of the cameras."""

    faults: tuple[str, ...]
    """What must be corrected before the capture is digitized, a sentence each."""
    notes: tuple[str, ...]
    """What should be known, a sentence each."""
    silhouette: NDArray[np.float64]
    """(camera,) share of the picture that is silhouette, mean of the frames."""
    explained: NDArray[np.float64]
    """(camera,) share of the silhouette that the hull of all cameras covers; NaN where unknown."""
    overlap: NDArray[np.float64]
    """(camera,) intersection over union of the silhouette and the hull of the others: both ways,
    but the fewer cameras there are the larger their hull; NaN where unknown."""
    empty: tuple[int, ...]
    """Which of the frames have no hull in the volume."""


@dataclass(frozen=True)
class _Case:
    """What all checks look at."""

    consistency: Consistency
    grid: VoxelGrid
    names: Sequence[str]
    settings: AgreementSettings
    by: By

    @property
    def frames(self) -> int:
        """How many are looked at."""
        return len(self.consistency.voxels)

    @property
    def usable(self) -> tuple[int, ...]:
        """The cameras whose silhouettes can be of a performer."""
        return self.consistency.usable


def check_agreement(
    silhouettes: NDArray[np.bool_],
    projection: Projection,
    grid: VoxelGrid,
    names: Sequence[str],
    settings: AgreementSettings = AgreementSettings(),
    by: By = "background",
) -> Agreement:
    """Compare the silhouettes of a few frames with each other, the cameras and the volume.

    Parameters
    ----------
    silhouettes : (time, camera, row, column) bool
        Some 8 frames spread over the take; beside a smaller image, False.
    projection
        The cameras, in the same order.
    grid
        The volume.
    names
        What the cameras are called.
    settings
        What is still agreement.
    by
        What told the performer from the stage; what is to be done depends on it.

    Returns
    -------
    Agreement

    Raises
    ------
    ValueError
        If the silhouettes, cameras and names do not fit each other.
    """
    _check_arguments(silhouettes, projection, names)
    pixels = projection.image_size.prod(axis=1)
    share = silhouettes.sum(axis=(2, 3)) / pixels
    unknown = np.full(projection.cameras, np.nan)
    nothing = Agreement((), (), share.mean(axis=0), unknown, unknown, tuple(range(len(share))))
    filled = np.median(share, axis=0) > settings.most_of_picture
    usable = tuple(int(c) for c in np.flatnonzero(share.any(axis=0) & ~filled))
    faults = [filled_fault(names[c], share[:, c], by) for c in map(int, np.flatnonzero(filled))]
    blind = [int(c) for c in np.flatnonzero(~share.any(axis=0))]
    if len(usable) < settings.min_cameras:
        said = _too_few_fault([names[c] for c in blind], len(usable), settings, by)
        return replace(nothing, faults=(*faults, said))
    consistency = measure_consistency(silhouettes, projection, grid, usable, settings.min_cameras)
    case = _Case(consistency, grid, names, settings, by)
    notes: list[str] = []
    _judge_blind(case, blind, faults, notes)
    explained, overlap = unknown.copy(), unknown.copy()
    fits = side_by_side(
        lambda c: (share_explained(consistency, usable, c), share_overlapped(consistency, c)),
        usable,
    )
    explained[list(usable)], overlap[list(usable)] = np.transpose(fits)
    trusted = _judge_cameras(case, explained, faults, notes)
    empty = _empty_frames(case)
    if trusted:
        _judge_volume(case, trusted, faults, notes)
        _judge_bodies(case, trusted, faults, notes)
    if not faults and empty:
        _judge_hulls(share, empty, faults, notes)
    return Agreement(
        tuple(faults), tuple(notes), nothing.silhouette, explained, overlap, tuple(empty)
    )


def _check_arguments(
    silhouettes: NDArray[np.bool_], projection: Projection, names: Sequence[str]
) -> None:
    """Refuse arrays that are not of these cameras."""
    count = projection.cameras
    columns, rows = projection.image_size.max(axis=0)
    wanted = (count, int(rows), int(columns))
    if silhouettes.dtype != np.bool_ or silhouettes.ndim != 4 or silhouettes.shape[1:] != wanted:
        raise ValueError(
            f"silhouettes are {silhouettes.dtype} of shape {silhouettes.shape}, but (time, "
            f"{', '.join(map(str, wanted))}) bool is wanted for these cameras"
        )
    if not len(silhouettes) or len(names) != count:
        raise ValueError(
            f"{len(silhouettes)} frames and {len(names)} names are given for {count} cameras; "
            "give a frame at least, and a name each"
        )


def _judge_blind(case: _Case, blind: Sequence[int], faults: list[str], notes: list[str]) -> None:
    """Say which cameras see nobody, and whether they should."""
    should, need_not = [], []
    for c in blind:
        hulls = [
            (voxels, case.consistency.hull(voxels, case.usable))
            for voxels in case.consistency.voxels
        ]
        size = sum(int(hull.sum()) for _, hull in hulls)
        filmed = sum(int((voxels.pixel[c, hull] >= 0).sum()) for voxels, hull in hulls)
        (should if filmed >= _FILMED * size else need_not).append(case.names[c])
    if should:
        faults.append(
            f"camera {listed(should)} sees nobody in any of the {case.frames} frames looked "
            f"at, although the others do: {blind_why(case.by)}"
        )
    if need_not:
        notes.append(
            f"Camera {listed(need_not)} sees nobody in the {case.frames} frames looked at: "
            "the performer is beside its picture."
        )


def _judge_cameras(
    case: _Case,
    explained: NDArray[np.float64],
    faults: list[str],
    notes: list[str],
) -> tuple[int, ...]:
    """Say which cameras disagree; return those that agree, none where films are mixed up."""
    usable = case.usable
    worst = min(float(explained[c]) for c in usable)
    if worst >= case.settings.consistent:
        return usable
    consistent = case.settings.consistent
    inconsistent = find_inconsistent_cameras(
        case.consistency, worst, consistent, case.settings.unexplained_ratio
    )
    others = tuple(c for c in usable if c not in inconsistent)
    exchanged = (
        ()
        if len(inconsistent) == 1
        else find_exchanged(case.consistency, case.grid, inconsistent, worst, consistent)
    )
    if exchanged:
        one, other = (case.names[c] for c in exchanged)
        faults.append(
            f"the films of camera {one!r} and {other!r} are exchanged, or their calibrations: as "
            f"they are, the hull explains only {worst:.0%} of a silhouette; rename them"
        )
        return ()
    harm = min(float(explained[c]) for c in others)
    if inconsistent:
        said = _inconsistency(case, inconsistent, explained)
        if harm < case.settings.harmed_below:
            faults.append(said)
        else:
            notes.append(said[0].upper() + said[1:] + ".")
        return others
    return _judge_all(case, worst, faults, notes)


def _inconsistency(
    case: _Case, inconsistent: tuple[int, ...], explained: NDArray[np.float64]
) -> str:
    """Return the sentence on cameras that disagree with the others."""
    others = [c for c in case.usable if c not in inconsistent]
    with_them = min(explained[c] for c in others)
    own = " and ".join(f"{share_explained(case.consistency, others, c):.0%}" for c in inconsistent)
    names = listed([case.names[c] for c in inconsistent])
    does, its, was = (
        ("disagrees", "its", "was") if len(inconsistent) == 1 else ("disagree", "their", "were")
    )
    return (
        f"camera {names} {does} with the others, whose hull explains {own} of {its} silhouette, "
        f"and of one of the others {least_explained(case.consistency, others):.0%} without and "
        f"{with_them:.0%} with {its} silhouette: {names} {was} moved after calibration, or shows "
        "another film, another moment, or more than the performer; calibrate again or leave it out"
    )


def _judge_all(case: _Case, least: float, faults: list[str], notes: list[str]) -> tuple[int, ...]:
    """Say how far all cameras agree where none alone is inconsistent; return who can be trusted."""
    said = f"the hull of all cameras explains only {least:.0%} of a silhouette"
    if len(case.usable) > case.settings.min_cameras:
        without = {c: [o for o in case.usable if o != c] for c in case.usable}
        best, worst = max((least_explained(case.consistency, without[c]), c) for c in case.usable)
        said += f", and {best:.0%} without camera {case.names[worst]!r}, which disagrees most"
    if least < case.settings.mixed_up_below:
        faults.append(
            f"{said}: films and calibrations of several cameras are mixed up, or the films do not "
            "begin at the same moment"
        )
        return ()
    notes.append(
        f"{said[0].upper()}{said[1:]}: the calibration is off by some pixels, or the silhouettes "
        "are; thin limbs will be missing."
    )
    return case.usable


def _empty_frames(case: _Case) -> list[int]:
    """Return the frames in which the hull of all cameras has no voxel in the volume."""
    empty = []
    for frame, voxels in enumerate(case.consistency.voxels):
        points = voxels.points[case.consistency.hull(voxels, case.usable)]
        if not is_inside(points, case.grid).any():
            empty.append(frame)
    return empty


def _judge_volume(case: _Case, trusted: Sequence[int], faults: list[str], notes: list[str]) -> None:
    """Say how much of the hull is outside the volume."""
    voxel_m = case.consistency.scene.voxel_m
    hulls = [
        main_parts(voxels.points[case.consistency.hull(voxels, trusted)], case.grid, voxel_m)
        for voxels in case.consistency.voxels
    ]
    tallest = max((float(np.ptp(hull[:, 1])) for hull in hulls if len(hull)), default=0.0)
    if tallest > case.settings.tallest_m:
        notes.append(
            f"The performer would be {tallest:.1f} m high: is the calibration in another unit, or "
            "its scale wrong? Say the unit under [video]."
        )
    points = np.concatenate(hulls)
    outside = ~is_inside(points, case.grid, voxel_m)
    share = float(outside.mean()) if len(outside) else 0.0
    if share < _LEAST_OUTSIDE:
        return
    floor_m = float(grid_corners(case.grid)[0][1])
    center, size = fitting_box(points, floor_m, case.settings.margin_m)
    said = (
        f"{share:.1%} of the performer is outside the volume; center_m = {center} and size_m = "
        f"{size} under [volume] would hold all that was seen"
    )
    if share > case.settings.most_outside:
        faults.append(said)
    else:
        notes.append(f"{said}.")


def _judge_bodies(case: _Case, trusted: Sequence[int], faults: list[str], notes: list[str]) -> None:
    """Say whether what is carved in the volume can be one performer."""
    hulls = [v.points[case.consistency.hull(v, trusted)] for v in case.consistency.voxels]
    inside = [hull[is_inside(hull, case.grid)] for hull in hulls]
    wrong, known = judge_bodies(inside, case.consistency.scene.voxel_m, case.by)
    faults += wrong
    notes += known


def _judge_hulls(
    share: NDArray[np.float64], empty: Sequence[int], faults: list[str], notes: list[str]
) -> None:
    """Say in how many frames nothing is carved."""
    said = f"othing is carved in {len(empty)} of the {len(share)} frames looked at"
    if len(empty) == len(share):
        faults.append(f"n{said}: look at the silhouettes")
    elif len(empty) == (~share.any(axis=1)).sum():
        notes.append(f"N{said}: nobody is seen there.")
    elif empty:
        notes.append(f"N{said}; they are stored as empty.")


def _too_few_fault(blind: Sequence[str], usable: int, settings: AgreementSettings, by: By) -> str:
    seen = f"camera {listed(blind)} sees nobody" if blind else "the others cannot be used"
    why = blind_why(by) if blind else "look at what the pictures of `shosa doctor` show"
    return (
        f"{seen} in any of the frames looked at, and {usable} cameras are left, where at least "
        f"{settings.min_cameras} are wanted: {why}"
    )
