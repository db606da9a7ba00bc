"""The body and the pose of a take into Zarr (digitization paper, Table 1)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from storage.arrays.groups import write_group
from storage.places import Place
from storage.provenance import Provenance
from storage.schema import JOINTS, SEGMENTS, SPACE

_FRAMES_A_CHUNK = 4096

_BODY = {
    "centroid": (("segment", "space"), "g: the middle of a segment's voxels", "m"),
    "axes": (("segment", "space", "axis"), "R(tau): principal axes in columns", "1"),
    "variance": (("segment", "axis"), "V: variances along the axes", "m2"),
    "offset": (("segment", "space"), "J: a segment's joint in its parent's system", "m"),
    "joint_offset": (("joint", "space"), "each joint in the system of the segment it is on", "m"),
    "volume_share": (("segment",), "share of the labeled voxels at first", "1"),
    "initial_joint": (("joint", "space"), "the joints that the body was measured with", "m"),
}
_POSE = {
    "position": (("time", "segment", "space"), "a segment's joint in the world", "m"),
    "rotation": (("time", "segment", "space", "axis"), "a segment's axes in the world", "1"),
    "local_position": (("time", "segment", "space"), "J in the parent's system", "m"),
    "local_rotation": (("time", "segment", "space", "axis"), "R(r) in the parent's system", "1"),
    "quality": (("time", "segment"), "0 to 1: how much of the segment is where it should be", "1"),
    "doubt": (
        ("time", "segment"),
        "probability that a joint at an end of the segment is more than 0.15 m off",
        "1",
    ),
    "doubtful": (("time",), "whether a person should look at the frame", None),
}


def write_body(
    place: Place,
    folder: str,
    body: Mapping[str, NDArray],
    *,
    attributes: Mapping[str, Any],
    provenance: Provenance,
) -> None:
    """Write the group `body` of the version in `folder`; each vector in a segment's own system.

    Parameters
    ----------
    body
        `centroid`, `axes`, `variance`, `offset`, `joint_offset`, `volume_share` and
        `initial_joint`.
    """
    dataset = xarray.Dataset(
        {name: _variable(name, values, _BODY) for name, values in body.items()},
        coords={"segment": list(SEGMENTS), "joint": list(JOINTS), "space": list(SPACE)},
        attrs={**_names(), **attributes, "provenance": provenance.attributes()},
    )
    write_group(place, folder, "body", dataset)


def write_pose(
    place: Place,
    folder: str,
    pose: Mapping[str, NDArray],
    *,
    rate_hz: float,
    attributes: Mapping[str, Any],
    provenance: Provenance,
) -> None:
    """Write the group `pose` of the version in `folder`.

    Parameters
    ----------
    pose
        `position`, `rotation`, `local_position`, `local_rotation`, `quality` and `doubtful`, and
        `doubt` where the method of the pose tells it.
    """
    frames = len(pose["doubtful"])
    dataset = xarray.Dataset(
        {name: _variable(name, values, _POSE) for name, values in pose.items()},
        coords={
            "time": ("time", np.arange(frames) / rate_hz, {"units": "s"}),
            "segment": list(SEGMENTS),
            "space": list(SPACE),
        },
        attrs={**_names(), "rate_hz": rate_hz, **attributes, "provenance": provenance.attributes()},
    )
    write_group(place, folder, "pose", dataset, frames_a_chunk=_FRAMES_A_CHUNK)


def _variable(name: str, values: NDArray, known: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return an array with its dims, its meaning and its unit."""
    dims, meaning, units = known[name]
    return dims, values, {"meaning": meaning} | ({"units": units} if units else {})


def _names() -> dict[str, list[str]]:
    """Return the names of segments and joints: string arrays are not in the v3 specification."""
    return {"segments": list(SEGMENTS), "joints": list(JOINTS)}
