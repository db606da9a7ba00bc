"""Read and write `initial.json`: the joints that a capture begins with, placed or corrected.

```json
{"frame": 0,
 "joints": {"Head": [0.0, 1.62, 0.1], "Neck": [0.0, 1.37, 0.1], "RFin": [-0.8, 1.3, 0.1]},
 "labels": [[9, 120], [11, 95]]}
```
`joints` are metres in the world, y up. `frame` and `labels` may be left out. `labels` are runs
over that frame's occupied voxels in order (x-major, then y, then z): segment 1 to 11 or 0 for
none, and how many voxels in a row have it.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside
from storage.formats.reading import decode_text, listed, read_bytes
from storage.schema import JOINTS, SEGMENTS

_WANTED = "a JSON file with `joints`: a name and [x, y, z] in metres each"
OPTIONAL = ("Waist", "RWrist", "RAnkle", "RHeel", "LWrist", "LAnkle", "LHeel")
"""Joints that may be left out; they are put in by the proportions of a body."""
_SMALLEST_M, _LARGEST_M = 0.4, 3.0  # from head to hips and on to the toes
_LONGEST = (
    *(("Shoulder", "Elbow", 0.30), ("Elbow", "Wrist", 0.28), ("Elbow", "Fin", 0.42)),
    *(("Hip", "Knee", 0.42), ("Knee", "Ankle", 0.42), ("Knee", "Foot", 0.52)),
)
"""The ends of bones, and 1.6 times their usual lengths (Drillis and Contini 1966), in shares of
the body from the head over neck, hips and knees to the toes."""
_NEVER_CROSSED = (("Shoulder", "Elbow"), ("Hip", "Knee"))
_MOST_BYTES = 1 << 24
"""Longest file [bytes]. Labels of a million voxels, each another than the last, have half of it."""
_MOST_VOXELS = 2**26  # a few bytes must not ask for more memory than any body needs


@dataclass(frozen=True, eq=False)
class Initial:
    """What an `initial.json` says."""

    position: NDArray[np.float64]
    """(21, 3) metres, joints as in `storage.schema.JOINTS`; NaN where left out."""
    frame: int | None
    """The frame they belong to; None where not said."""
    label: NDArray[np.uint8] | None
    """(voxel,) segment 0 to 11 of that frame's voxels in order; None where not said."""


def read_initial(path: str | Path) -> Initial:
    """Return the joints, and the frame and labels where given, of an `initial.json`.

    Raises
    ------
    InputError
        The file cannot be read or is no such JSON, joints are missing, unknown or no points,
        right and left are swapped, or the body is upside down or not in metres: every fault
        of the file at once.
    """
    path = Path(path)
    text, _ = decode_text(path, read_bytes(path, _WANTED, most=_MOST_BYTES), _WANTED)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON ({error}); bring {_WANTED}") from error
    if not isinstance(content, dict) or not isinstance(content.get("joints"), dict):
        raise InputError(f"{path} has no table `joints`; bring {_WANTED}")
    faults = []
    unknown = [str(key) for key in content if key not in ("frame", "joints", "labels")]
    if unknown:
        faults.append(f"{listed(unknown)} is not known; wanted are frame, joints and labels")
    position = _read_joints(content["joints"], faults)
    frame = content.get("frame")
    if frame is not None and not (_is_count(frame)):
        faults.append(f"frame {str(frame)[:40]} must be a whole number from 0")
    label = _read_labels(content.get("labels"), faults)
    if not faults:
        faults = joint_faults(position)
    if faults:
        raise InputError(f"{path} cannot be used: {'; '.join(faults)}")
    return Initial(position, frame, label)


def write_initial(
    path: str | Path,
    position: NDArray[np.floating],
    *,
    frame: int | None = None,
    label: NDArray[np.integer] | None = None,
) -> None:
    """Write an `initial.json`.

    Parameters
    ----------
    path
        Replaced when the whole file has been written.
    position : (21, 3) float
        Metres; joints that are NaN are left out.
    frame
        The frame they belong to.
    label : (voxel,) int
        Segment 0 to 11 of that frame's voxels in order.

    Raises
    ------
    ValueError
        The arrays have other shapes or values, or a joint that is needed is NaN.
    OSError
        The file cannot be written; what was there before is still there.
    """
    position = np.asarray(position, np.float64)
    if position.shape != (len(JOINTS), 3):
        raise ValueError(f"position is {position.shape}, wanted is ({len(JOINTS)}, 3)")
    found = {n: p for n, p in zip(JOINTS, position, strict=True) if np.isfinite(p).all()}
    missing = [name for name in JOINTS if name not in found and name not in OPTIONAL]
    if missing:
        raise ValueError(f"{listed(missing)} must be finite to be written; place them first")
    lines = [f'  "{n}": [{", ".join(f"{v:.4f}" for v in p)}]' for n, p in found.items()]
    parts = [] if frame is None else [f' "frame": {int(frame)}']
    parts.append(' "joints": {\n' + ",\n".join(lines) + "\n }")
    if label is not None:
        label = np.asarray(label)
        if label.ndim != 1 or ((label < 0) | (label > len(SEGMENTS))).any():
            raise ValueError(f"labels must be one axis of numbers from 0 to {len(SEGMENTS)}")
        begin = np.flatnonzero(np.diff(label, prepend=-1))
        count = np.diff(begin, append=len(label))
        runs = ",".join(f"[{k},{n}]" for k, n in zip(label[begin], count, strict=True))
        parts.append(f' "labels": [{runs}]')
    write_beside(Path(path), ("{\n" + ",\n".join(parts) + "\n}\n").encode())


def joint_faults(position: NDArray[np.float64]) -> list[str]:
    """Return what is wrong with joints (21, 3), by themselves: a sentence each."""
    place = dict(zip(JOINTS, position, strict=True))
    hips = (place["RHip"] + place["LHip"]) / 2.0
    faults = []
    if place["Head"][1] <= hips[1]:
        faults.append("the head is below the hips; y must point up, exchange the axes")
    toes = (place["RFoot"] + place["LFoot"]) / 2.0
    size = float(np.linalg.norm(place["Head"] - hips) + np.linalg.norm(hips - toes))
    if not _SMALLEST_M <= size <= _LARGEST_M:
        faults.append(
            f"the body is {size:.3g} m from head over hips to toes, wanted are {_SMALLEST_M} to "
            f"{_LARGEST_M}; give metres"
        )
    across, shoulders = (place[f"L{name}"] - place[f"R{name}"] for name in ("Hip", "Shoulder"))
    if across @ shoulders <= 0:
        faults.append("right and left are exchanged between hips and shoulders; exchange one pair")
        return faults
    front = np.cross(across + shoulders, [0.0, 1.0, 0.0])
    ahead = 0.0
    for side in "RL":
        behind = next(
            place[f"{side}{name}"]
            for name in ("Heel", "Ankle", "Knee")
            if np.isfinite(place[f"{side}{name}"]).all()
        )
        ahead += float((place[f"{side}Foot"] - behind) @ front)
    if ahead < 0:
        faults.append(
            "the toes point backward: right and left are swapped, or toes and heels; exchange them"
        )
    return faults + _bone_faults(place)


def _bone_faults(place: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return which bones are too long for the body, and which pairs of joints are swapped."""

    def length(a: str, b: str) -> float:
        return float(np.linalg.norm(place[a] - place[b]))

    hips = (place["RHip"] + place["LHip"]) / 2.0
    trunk = length("Head", "Neck") + float(np.linalg.norm(place["Neck"] - hips))
    legs = [length(f"{s}Hip", f"{s}Knee") + length(f"{s}Knee", f"{s}Foot") for s in "RL"]
    size = trunk + min(legs)
    faults = []
    for near, name, share in _LONGEST:
        own = [length(s + near, s + name) for s in "RL"]
        crossed = [length(a + near, b + name) for a, b in ("RL", "LR")]
        if not np.isfinite([*own, *crossed]).all():
            continue
        if (near, name) in _NEVER_CROSSED and np.less(crossed, own).all():
            faults.append(f"R{name} and L{name} are swapped; exchange them")
            continue
        too_long = [side for side, each in zip("RL", own, strict=True) if each > share * size]
        if len(too_long) == 2 and max(crossed) < min(own):
            faults.append(f"R{name} and L{name} are swapped; exchange them")
        else:
            faults += [
                f"{side}{near} to {side}{name} is {length(side + near, side + name):.2f} m, too "
                f"long for a body of {size:.2f} m; place one of them anew"
                for side in too_long
            ]
    return faults


def _read_joints(table: Mapping[str, Any], faults: list[str]) -> NDArray[np.float64]:
    """Return the joints (21, 3), NaN where there is none, and add what is wrong."""
    position = np.full((len(JOINTS), 3), np.nan)
    unknown = [name for name in table if name not in JOINTS]
    if unknown:
        faults.append(f"{listed(unknown)} is no joint; the joints are {', '.join(JOINTS)}")
    bad = []
    for number, name in enumerate(JOINTS):
        place = table.get(name)
        if place is None:
            continue
        if isinstance(place, list) and len(place) == 3 and all(_is_number(v) for v in place):
            position[number] = place
        else:
            bad.append(name)
    if bad:
        faults.append(f"{listed(bad)} must be three finite numbers [x, y, z] in metres")
    missing = [name for name in JOINTS if table.get(name) is None and name not in OPTIONAL]
    if missing:
        faults.append(
            f"{listed(missing, 14)} is missing; place it (only {listed(OPTIONAL)} may be)"
        )
    return position


def _read_labels(runs: Any, faults: list[str]) -> NDArray[np.uint8] | None:
    """Return the label of each voxel, None where there are none, and add what is wrong."""
    if runs is None:
        return None
    good = isinstance(runs, list) and all(
        isinstance(run, list)
        and len(run) == 2
        and _is_count(run[0])
        and run[0] <= len(SEGMENTS)
        and _is_count(run[1])
        for run in runs
    )
    if not good or sum(run[1] for run in runs) >= _MOST_VOXELS:
        faults.append(
            f"labels must be a list of [segment 0 to {len(SEGMENTS)}, number of voxels]; leave "
            "them out and they are made from the joints"
        )
        return None
    table = np.array(runs, np.int64).reshape(-1, 2)
    return np.repeat(table[:, 0].astype(np.uint8), table[:, 1])


def _is_number(value: Any) -> bool:
    """Return whether a JSON value is a finite number of sensible size."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) < 1e6 and math.isfinite(value)


def _is_count(value: Any) -> bool:
    """Return whether a JSON value is a whole number from 0."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MOST_VOXELS
