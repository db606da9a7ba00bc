"""Make a joint track of a motion file: units, axes, joints, gaps, floor, stature.

What the file does not say is inferred from the performer's body, and every inference is said
in the track's notes (docs/contract.md, section 3).
"""

import logging
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.arrays.groups import write_motion
from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.motion.joint_map import JointMap
from storage.formats.motion.joint_map import read_joint_map as read_joint_map
from storage.formats.motion.motion_file import MotionFile
from storage.places import Place
from storage.provenance import Provenance, digest_file, recorded
from storage.publication import describe_files, discard_version, new_version, version_folder
from storage.recordings import Recording
from storage.records import Record
from storage.schema import JOINTS
from tasks.engine.fingerprints import code_behind
from tasks.engine.settings import NotNegative, Positive
from tasks.motion.bearings import AXES, find_floor, find_unit, find_up, side_notes
from tasks.motion.gaps import fill_gaps, filter_low_pass
from tasks.motion.marker_choice import choose_points, place_joints
from tasks.motion.said import gap_notes, joint_faults, joint_notes
from tasks.motion.stature import DEFAULT_STATURE_M, joints_present, measure_stature
from tasks.motion.strays import remove_strays

logger = logging.getLogger(__name__)

Positions = NDArray[np.float64]


@dataclass(frozen=True)
class ImportSettings:
    """Everything that changes what is made of a motion file."""

    longest_gap_s: NotNegative = 0.2
    """Gaps up to this long are filled. In a fifth of a second a limb changes its direction
    once at most, which a cubic can follow; after longer ones a spline only invents."""
    low_pass_hz: Positive | None = None
    """Above this the joints' movement is taken for noise and removed; None leaves it. What is noise
    depends on the recording, so nothing is removed unasked."""
    scale: Positive | None = None
    """Length of one unit of the file, whatever the file says [m]. None infers it from the file and
    from the performer's body."""
    up: str | None = None
    """The axis that points up ("x", "y", "z", "-x", "-y" or "-z"), whatever the file says. None
    infers it from the file and from the performer's body."""
    mapping: JointMap | None = None
    """Joints and their markers, which come before any marker set. None chooses the marker set by
    the names."""
    stature_m: Positive | None = None
    """The performer's stature, where it is known. None measures it on the joints."""


@dataclass(frozen=True)
class JointTrack:
    """The 21 joints over a take."""

    position: NDArray[np.float32]
    """(time, 21, 3), metres, Y up, floor at 0; NaN where a joint is missing."""
    filled: NDArray[np.bool_]
    """(time, 21), True where the joint stands on a marker that was missing in the file."""
    rate_hz: float
    stature_m: float | None
    """As the search measures it (docs/contract.md, section 6), or as it was given."""
    stature_source: str
    """"measured", "given" or "unknown"."""
    marker_set: str
    notes: tuple[str, ...]
    """Every inference, a sentence each."""


def make_joint_track(
    motion: MotionFile, settings: ImportSettings | None = None, *, file_name: str
) -> JointTrack:
    """Return the joints of a motion file, in metres, Y up, with the floor at 0.

    Parameters
    ----------
    motion
        As read from the file.
    settings
        By default all is inferred, short gaps are filled and nothing is smoothed.
    file_name
        For the messages.

    Raises
    ------
    InputError
        The file lacks a hip (they are the frame of the body) or has fewer than six joints, the
        map asks for markers that it has not, its unit makes a body of no human size, or its
        rate is too low for the low-pass; all that is wrong is said at once.
    ValueError
        A setting makes no sense for any file.
    """
    settings = settings or ImportSettings()
    _check_settings(settings)
    raw = _without_infinite(motion.position)
    choice = choose_points(motion.names, _present(motion.names, raw), settings.mapping or ())
    faults = [*choice.faults, *_low_pass_faults(motion, settings)]
    unit_m, unit_notes = math.nan, []
    if no_body := list(joint_faults(place_joints(raw, choice), choice, motion)):
        faults += no_body
    else:
        unit_m, unit_notes, unit_faults = find_unit(
            raw, choice, motion, scale=settings.scale, stature_m=settings.stature_m
        )
        faults += [] if choice.faults else unit_faults  # the size may hang on what is mapped
    if faults:
        raise InputError(f"{file_name} cannot be imported: {'; '.join(faults)}")
    choice, markers = choice.alone()
    names = tuple(motion.names[i] for i in markers)
    longest = math.floor(settings.longest_gap_s * motion.rate_hz + 1e-9)
    measured, stray_notes, faults = remove_strays(raw[:, markers] * unit_m, names, motion.rate_hz)
    if stray_notes:  # what is left may be no body
        faults += joint_faults(place_joints(measured, choice), choice, motion)
    if faults:
        raise InputError(f"{file_name} cannot be imported: {'; '.join([*faults, *stray_notes])}")
    whole = fill_gaps(measured, longest)
    position = place_joints(whole, choice)
    filled = np.isfinite(position[..., 0])
    filled &= False if whole is measured else np.isnan(place_joints(measured, choice)[..., 0])
    gaps = list(gap_notes(measured, whole, names, longest))
    del measured, whole  # of a long take they are large
    rest = None if motion.rest is None else place_joints(motion.rest[None, markers], choice)
    up, up_notes = find_up(position, motion, up=settings.up, rest=rest)
    if up != "y":
        position = position @ AXES[up].T
    notes = [
        *motion.notes,
        *joint_notes(choice, position),
        *choice.notes,
        *unit_notes,
        *up_notes,
        *stray_notes,
        *gaps,
        *side_notes(position),
    ]
    if settings.low_pass_hz is not None:
        position = filter_low_pass(position, motion.rate_hz, settings.low_pass_hz)
        notes.append(f"Movement above {settings.low_pass_hz:g} Hz was filtered out.")
    shift, floor_notes = find_floor(position, motion, choice)
    position[..., 1] += shift
    stature_m, source, stature_notes = _find_stature(position, settings)
    return JointTrack(
        position.astype(np.float32),
        filled,
        motion.rate_hz,
        stature_m,
        source,
        choice.marker_set,
        (*notes, *floor_notes, *stature_notes),
    )


def _check_settings(settings: ImportSettings) -> None:
    faults = []
    if not (math.isfinite(settings.longest_gap_s) and settings.longest_gap_s >= 0):
        faults.append(f"longest_gap_s is {settings.longest_gap_s}, wanted are seconds from 0 up")
    for name in ("low_pass_hz", "scale", "stature_m"):
        value = getattr(settings, name)
        if value is not None and not (math.isfinite(value) and value > 0):
            faults.append(f"{name} is {value}, wanted is a number above 0")
    if settings.up is not None and settings.up not in AXES:
        faults.append(f"up is {settings.up!r}, wanted is one of {', '.join(AXES)}")
    if faults:
        raise ValueError("; ".join(faults))


def _without_infinite(position: Positions) -> Positions:
    if position.size and np.isfinite(position.max()) and np.isfinite(position.min()):
        return position  # a long take is not copied for nothing
    whole = np.isfinite(position).all(axis=2, keepdims=True)
    return np.where(whole, position, np.nan)


def _present(names: tuple[str, ...], raw: Positions) -> NDArray[np.bool_]:
    """Return where a marker is there; an end site that lies on its own bone says nothing."""
    present = ~np.isnan(raw[..., 0])
    place = {name: i for i, name in enumerate(names)}
    for i, name in enumerate(names):
        bone = place.get(name.removesuffix(" End"), i) if name.endswith(" End") else i
        if bone != i and np.allclose(raw[:, i], raw[:, bone], atol=1e-6, equal_nan=True):
            present[:, i] = False
    return present


def _low_pass_faults(motion: MotionFile, settings: ImportSettings) -> Iterator[str]:
    if settings.low_pass_hz is not None and settings.low_pass_hz >= motion.rate_hz / 2:
        yield (
            f"a low-pass at {settings.low_pass_hz:g} Hz is asked for, but at "
            f"{motion.rate_hz:g} frames a second it must be below {motion.rate_hz / 2:g} Hz"
        )


def _find_stature(
    position: Positions, settings: ImportSettings
) -> tuple[float | None, str, list[str]]:
    """Return the stature, where it comes from, and what is to be said of it."""
    if settings.stature_m is not None:
        return settings.stature_m, "given", []
    stature = measure_stature(position, JOINTS)
    if math.isnan(stature):
        note = (
            "The stature is unknown, because head, neck or a leg is missing: the take is compared "
            f"as one of {DEFAULT_STATURE_M} m; stature_m in its metadata says better."
        )
        return None, "unknown", [note]
    return stature, "measured", []


def read_joint_track(path: Path, settings: ImportSettings) -> tuple[JointTrack, str]:
    """Return the joint track of a motion file, and the kind of file that it is.

    Raises
    ------
    InputError
        If the file cannot be read, or holds no body.
    """
    motion = read_motion_file(path)
    return make_joint_track(motion, settings, file_name=path.name), motion.source


def settings_for(recording: Recording, settings: ImportSettings) -> ImportSettings:
    """Return the settings for one file: with the stature that its metadata give."""
    return replace(settings, stature_m=recording.stature_m or settings.stature_m)


def changed_import_settings(settings: ImportSettings) -> dict[str, Any]:
    """Return the settings that are not the defaults, by name, as JSON can hold them."""
    usual = ImportSettings()
    changed = {
        f"importing.{name}": value
        for name, value in asdict(settings).items()
        if value != getattr(usual, name)
    }
    if settings.mapping is not None:
        changed["importing.mapping"] = {joint: list(names) for joint, names in settings.mapping}
    return changed


def import_take(archive: str, recording: Recording, settings: ImportSettings) -> dict[str, Any]:
    """Write a version of the take that a motion file becomes, without publishing it.

    Returns
    -------
    dict
        The fields of its `Record`, as JSON can hold them; `publish_take` gives it its number.

    Raises
    ------
    InputError
        If the file cannot be used, or has changed since it was planned.
    """
    place = open_archive(archive).place
    settings = settings_for(recording, settings)
    with recorded(
        "importing", settings=asdict(settings), inputs={recording.path: recording.digest}
    ) as provenance:
        path = Path(recording.path)
        track, kind = read_joint_track(path, settings)
        if digest_file(path) != recording.digest:
            raise InputError(f"{path} changed while it was read; ingest it again when it is done")
    source = {
        "kind": kind,
        "name": path.name,
        "path": recording.path,
        "digest": recording.digest,
        "code": code_behind(__name__),
    }
    version, files = _write_version(place, recording, track, source, provenance)
    draft = Record(
        take=recording.take,
        version=version,
        number=0,
        source=source,
        metadata=recording.metadata,
        frames=len(track.position),
        rate_hz=track.rate_hz,
        joints_present=[
            joint
            for joint, there in zip(JOINTS, joints_present(track.position), strict=True)
            if there
        ],
        stages=["motion"],
        files=files,
        notes=list(track.notes),
        settings=changed_import_settings(settings),
    )
    return asdict(draft)


def _write_version(
    place: Place,
    recording: Recording,
    track: JointTrack,
    source: dict[str, str],
    provenance: Provenance,
) -> tuple[str, dict[str, dict[str, Any]]]:
    """Write a version of a take, or nothing; return its name and its files."""
    version = new_version(place, recording.take)
    try:
        write_motion(
            place,
            version_folder(recording.take, version),
            position=track.position,
            filled=track.filled,
            rate_hz=track.rate_hz,
            attributes={
                "source": source,
                "metadata": recording.metadata,
                "stature_m": track.stature_m,
                "stature_source": track.stature_source,
                "marker_set": track.marker_set,
                "notes": list(track.notes),
            },
            provenance=provenance,
        )
        return version, describe_files(place, recording.take, version)
    except BaseException:
        discard_version(place, recording.take, version)
        raise
