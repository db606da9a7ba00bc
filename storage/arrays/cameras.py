"""The cameras of a take into Zarr: the group `cameras`, a row a camera."""

from collections.abc import Sequence

import numpy as np
import xarray

from storage.arrays.groups import write_group
from storage.formats.calibration.camera import Camera
from storage.places import Place
from storage.provenance import Provenance
from storage.schema import SPACE


def write_cameras(
    place: Place, folder: str, cameras: Sequence[Camera], provenance: Provenance,
    first_frames: Sequence[int] = (),
) -> None:  # fmt: skip
    """Write the group `cameras` of the version in `folder`: metres, y up, OpenCV's lens.

    `first_frames` are the frames of their films that are frame 0 of the take, 0 by default.
    """
    distortion = np.zeros((len(cameras), 8))
    for row, camera in zip(distortion, cameras, strict=True):
        row[: len(camera.distortion)] = camera.distortion
    names = [camera.name for camera in cameras]
    size = np.array([camera.size for camera in cameras], np.int64)
    dataset = xarray.Dataset(
        {
            "intrinsics": (
                ("camera", "row_of_matrix", "column_of_matrix"),
                np.stack([camera.intrinsics for camera in cameras]),
                {"units": "px", "meaning": "pixel centers at integers"},
            ),
            "distortion": (("camera", "coefficient"), distortion),
            "rotation": (
                ("camera", "space_of_camera", "space"),
                np.stack([camera.rotation for camera in cameras]),
                {"meaning": "from the world's axes to the camera's: x right, y down, z ahead"},
            ),
            "translation": (
                ("camera", "space_of_camera"),
                np.stack([camera.translation for camera in cameras]),
                {"units": "m", "meaning": "x = intrinsics (rotation X + translation)"},
            ),
            "image_size": (("camera", "side"), size, {"meaning": "columns, rows", "units": "px"}),
            "first_frame": (
                ("camera",),
                np.array(first_frames or [0] * len(cameras), np.int64),
                {"meaning": "the frame of the camera's film that is frame 0 of the take"},
            ),
        },
        coords={"camera": names, "space": list(SPACE)},
        attrs={
            "cameras": names,  # string arrays are not in the v3 specification
            "coefficients": ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            "provenance": provenance.attributes(),
        },
    )
    write_group(place, folder, "cameras", dataset)
