"""The joints and boundaries that a person places in a frame: where they start, what they label.

A boundary between two segments goes through their joint. It can be moved away from it: then the
voxels are labeled as if the joint were there, while the joint itself stays (digitization paper,
section 3.3). What neither gets right is painted: each touch of the brush is a ball, whose voxels
are of one segment then. `initial.json` keeps the joints, and the labels that came of it all.
"""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.archive import Take
from storage.errors import ArchiveError, InputError
from storage.formats.capture.initial import joint_faults, read_initial, write_initial
from storage.places import told
from storage.schema import JOINTS, SEGMENTS
from tasks.body.anatomy.nearest_bones import PLACED_JOINTS, label_points
from tasks.body.anatomy.proportions import complete_joints
from viewer.holdings import Holdings

FILE = "initial.json"
BOUNDARIES = (
    "Neck", "Waist",
    *(side + name for side in "RL" for name in ("Shoulder", "Elbow", "Hip", "Knee")),
)  # fmt: skip
"""The joints at which two segments meet."""
_STANDING = {
    "Head": (0.0, 1.0), "Neck": (0.0, 0.84), "Waist": (0.0, 0.62), "Shoulder": (0.11, 0.82),
    "Elbow": (0.28, 0.82), "Wrist": (0.43, 0.82), "Fin": (0.53, 0.82), "Hip": (0.06, 0.52),
    "Knee": (0.07, 0.28), "Ankle": (0.07, 0.05), "Heel": (0.07, 0.01), "Foot": (0.07, 0.01),
}  # fmt: skip
"""Joints of a body with stretched arms, to the left and up [heights]. Only a beginning: a person
drags them from there (after Drillis and Contini 1966)."""
_MOST_TOUCHES = 4000
"""How many touches of the brush are taken. Chosen: nobody paints so long."""
_FOOT_AHEAD = 0.12
"""How far the toes are ahead of the heels [heights]."""


@dataclass(frozen=True, eq=False)
class Start:
    """What the page begins with."""

    frame: int
    position: NDArray[np.float64]
    """(21, 3) m."""
    source: str
    """Where the joints are from: "file", "body", "track" or "standing"."""
    digest: str
    """Of the `initial.json` in the capture, "" where there is none."""
    labeled: bool = False
    """Whether that has labels of its own, which stay until something is moved."""


def capture_folder(take: Take) -> Path | None:
    """Return the folder of a take's recording, if it is on this machine."""
    path = Path(take.record.source["path"])
    return path if take.record.source["kind"] == "capture" and path.is_dir() else None


def file_digest(take: Take) -> str:
    """Return the digest of the capture's `initial.json`, "" where there is none."""
    folder = capture_folder(take)
    if folder is None or not (folder / FILE).is_file():
        return ""
    return hashlib.sha256((folder / FILE).read_bytes()).hexdigest()


def start_of(take: Take, frame: int | None) -> Start:
    """Return the joints to begin with: a person's, the stage's, the track's, or a standing body.

    Raises
    ------
    ArchiveError
        If the take has no voxels, or is damaged.
    InputError
        If there is no such frame, or nobody in it.
    """
    folder, digest = capture_folder(take), file_digest(take)
    if folder is not None and digest:
        try:
            given = read_initial(folder / FILE)
        except InputError:
            given = None  # a file that cannot be used is replaced when the page saves
        if given is not None and frame in (None, given.frame or 0):
            labeled = given.label is not None
            return Start(given.frame or 0, given.position, "file", digest, labeled)
    if "body" in take.record.stages:
        body = take.body
        found = int(body.attrs["initial_frame"])
        if frame in (None, found):
            position = np.asarray(body["initial_joint"].values, np.float64)
            return Start(found, position, "body", digest)
    shown = frame or 0
    if not 0 <= shown < take.record.frames:
        raise InputError(
            f"take {take.name!r} has the frames 0-{take.record.frames - 1}; {shown} goes beyond"
        )
    if "motion" in take.record.stages:
        position = np.asarray(take.motion["position"][shown].values, np.float64)
        if all(np.isfinite(position[JOINTS.index(joint)]).all() for joint in PLACED_JOINTS):
            return Start(shown, position, "track", digest)
    return Start(shown, _standing(take.voxels(shown)["center"].values), "standing", digest)


def label_frame(
    holdings: Holdings, take: Take, frame: int, content: Mapping[str, Any]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the label of each voxel of a frame (voxel,), and which are on the surface.

    Parameters
    ----------
    content
        `joints`: [x, y, z] or None for each of the 21; `boundaries`: name of a joint to where the
        boundary that usually goes through it is; `touches`: [x, y, z, radius, segment] of each
        touch of the brush, m; `kept`: whether the labels of the file are those to begin with.

    Raises
    ------
    InputError
        If a joint that has to be placed is not, or something is no touch.
    """
    center, is_surface = holdings.held_voxels(take, frame)
    label = _kept_labels(take, frame, len(center)) if content.get("kept") else None
    if label is None:
        label = _label_by_joints(center, content)
    for x, y, z, radius, segment in _read_touches(content.get("touches")):
        label[((center - [x, y, z]) ** 2).sum(axis=1) <= radius**2] = int(segment)
    return label, is_surface


def _kept_labels(take: Take, frame: int, voxels: int) -> NDArray[np.uint8] | None:
    """Return the labels of the capture's `initial.json`, None where it has none of this frame."""
    folder = capture_folder(take)
    if folder is None:
        return None
    try:
        given = read_initial(folder / FILE)
    except InputError:
        return None
    fits = given.label is not None and (given.frame or 0) == frame and len(given.label) == voxels
    return given.label.copy() if given.label is not None and fits else None


def _label_by_joints(center: NDArray[np.float64], content: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Return the labels that follow from joints and boundaries."""
    position = _read_joints(content.get("joints"))
    for name, place in dict(content.get("boundaries") or {}).items():
        if name in BOUNDARIES:
            position[JOINTS.index(name)] = _point(place)
    missing = [n for n in PLACED_JOINTS if not np.isfinite(position[JOINTS.index(n)]).all()]
    if missing:
        raise InputError(f"{', '.join(missing)} must be placed")
    joints = complete_joints(dict(zip(JOINTS, position, strict=True)))
    return label_points(center, joints)


def shares_of(label: NDArray[np.uint8]) -> list[float]:
    """Return the share of the voxels that each of the 11 segments has."""
    count = np.bincount(label, minlength=len(SEGMENTS) + 1)[1:]
    return (count / max(1, len(label))).round(5).tolist()


def save_model(
    holdings: Holdings,
    take: Take,
    frame: int,
    content: Mapping[str, Any],
    *,
    into: Path,
) -> None:
    """Write what a person placed as `initial.json`, in `into`.

    Raises
    ------
    InputError
        If the joints are no body, or not all there: every fault at once.
    PlaceError
        If the file cannot be written.
    """
    position = _read_joints(content.get("joints"))
    label, _ = label_frame(holdings, take, frame, content)
    if faults := joint_faults(position):
        raise InputError("; ".join(faults))
    empty = [name for name, share in zip(SEGMENTS, shares_of(label), strict=True) if not share]
    if empty:
        raise InputError(f"{', '.join(empty)} has no voxel; move its joints or boundaries")
    with told(f"write {into}"):
        by_hand = any(content.get(what) for what in ("boundaries", "touches", "kept"))
        own = label if by_hand else None  # without, they follow from the joints
        write_initial(into, position, frame=frame, label=own)


def save_into_capture(
    holdings: Holdings, take: Take, frame: int, content: Mapping[str, Any]
) -> Path:
    """Write `initial.json` into the take's capture; return where it is.

    Raises
    ------
    InputError
        As `save_model`; or if the capture is not on this machine.
    ArchiveError
        If somebody else has written one since the page was opened.
    """
    folder = capture_folder(take)
    if folder is None:
        raise InputError(
            f"the capture {take.record.source['path']} is not on this machine; download the file "
            "and put it there"
        )
    if content.get("digest", "") != file_digest(take):
        raise ArchiveError(
            f"somebody else has saved {folder / FILE} since this page was opened; load the page "
            "again to see it, or download yours"
        )
    save_model(holdings, take, frame, content, into=folder / FILE)
    return folder / FILE


def _standing(center: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the joints of a body that stands where the voxels (voxel, 3) are, facing +Z."""
    if not len(center):
        raise InputError("nobody is in this frame; choose another")
    low, high = center.min(axis=0), center.max(axis=0)
    middle, tall = (low + high) / 2, float(high[1] - low[1])
    position = np.empty((len(JOINTS), 3))
    for number, joint in enumerate(JOINTS):
        own = joint if joint in _STANDING else joint[1:]
        aside, up = _STANDING[own]
        side = {"R": -1.0, "L": 1.0}[joint[0]] if own != joint else 0.0
        ahead = _FOOT_AHEAD if own == "Foot" else 0.0
        position[number] = [
            middle[0] + side * aside * tall, low[1] + up * tall, middle[2] + ahead * tall,
        ]  # fmt: skip
    return position


def _read_joints(places: Any) -> NDArray[np.float64]:
    """Return joints (21, 3) as a page sends them."""
    if not isinstance(places, list) or len(places) != len(JOINTS):
        raise InputError(f"{len(JOINTS)} joints are wanted")
    return np.array([_point(place) for place in places])


def _point(place: Any) -> list[float]:
    """Return a point as a page sends it, NaN for none."""
    if place is None:
        return [math.nan] * 3
    if not isinstance(place, list) or len(place) != 3:
        raise InputError("a joint should be [x, y, z]")
    return [float(v) if isinstance(v, int | float) else math.nan for v in place]


def _read_touches(touches: Any) -> list[list[float]]:
    """Return the touches of the brush as a page sends them."""
    if touches is None:
        return []
    if not isinstance(touches, list) or len(touches) > _MOST_TOUCHES:
        raise InputError(f"up to {_MOST_TOUCHES} touches of the brush are wanted")
    for touch in touches:
        good = isinstance(touch, list) and len(touch) == 5
        if not good or not all(isinstance(v, int | float) and math.isfinite(v) for v in touch):
            raise InputError("a touch of the brush should be [x, y, z, radius, segment]")
        if touch[4] not in range(1, len(SEGMENTS) + 1):
            raise InputError(f"a segment is a number from 1 to {len(SEGMENTS)}")
    return touches
