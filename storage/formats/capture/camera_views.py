"""Whether the cameras of a capture look at its volume, and from how far."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.camera import Y_UP_FROM, Camera, turn_y_up
from storage.formats.capture.capture_toml import Volume
from storage.formats.reading import listed

_STEPS = 9  # points along each axis of the volume
_UNSEEN = 0.01  # a share of the volume below which a camera is said not to look at it
_SMALLEST = 0.08  # of the image's diagonal: a volume that is smaller there is too far away
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}


def share_seen(camera: Camera, volume: Volume) -> float:
    """Return the share of the volume, 0 to 1, that a camera films.

    A point counts when it is before the camera, in the cone that the image's border spans (the
    distortion folds points from outside it back into the image), and filmed in the image.
    """
    points = _grid(volume)
    seen = points @ camera.rotation.T + camera.translation
    ahead = seen[:, 2] > 1e-9
    if not ahead.any():
        return 0.0
    plane = seen[ahead, :2] / seen[ahead, 2:]
    pixel, _ = cv2.projectPoints(
        seen[ahead], np.zeros(3), np.zeros(3), camera.intrinsics, camera.distortion
    )
    column, row = pixel.reshape(-1, 2).T
    inside = (column >= -0.5) & (column < camera.width - 0.5)
    inside &= (row >= -0.5) & (row < camera.height - 0.5)
    inside &= np.linalg.norm(plane, axis=1) <= 1.05 * _widest(camera)
    return float(inside.sum() / len(points))


def count_seeing(cameras: Sequence[Camera], volume: Volume) -> int:
    """Return how many cameras see the volume: none where all are far too far away, or within."""
    if _distance_fault(cameras, volume, 1.0):
        return 0
    return sum(share_seen(camera, volume) >= _UNSEEN for camera in cameras)


def view_faults(
    cameras: Sequence[Camera], volume: Volume, unit_m: float, *, assumed: bool = False
) -> tuple[list[float], list[str]]:
    """Return the share of the volume that each camera sees, and what is wrong.

    Parameters
    ----------
    cameras : sequence of Camera
        With their image sizes.
    volume : Volume
        What they should see.
    unit_m : float
        Metres in the unit that the calibration was read in, to say which would fit better.
    assumed : bool
        Whether nothing said that unit.
    """
    unit = (
        f"; the calibration does not say its unit and was read in {_called(unit_m)}: where that is "
        "wrong, write unit under [video]"
        if assumed
        else ""
    )
    shares = [share_seen(camera, volume) for camera in cameras]
    fault = _distance_fault(cameras, volume, unit_m)
    if fault:
        return shares, [fault + unit]
    blind = [camera.name for camera, share in zip(cameras, shares, strict=True) if share < _UNSEEN]
    if not blind:
        return shares, []
    sees = "does" if len(blind) == 1 else "do"
    return shares, [
        f"camera {listed(blind)} {sees} not see the volume around "
        f"{[round(value, 3) for value in volume.center_m]}; "
        f"{_hint(cameras, volume, shares) or 'correct [volume], or the calibration'}"
        f"{unit}"
    ]


def _called(unit_m: float) -> str:
    return next((name for name, value in _UNITS.items() if value == unit_m), f"{unit_m:g} m")


def _grid(volume: Volume) -> NDArray[np.float64]:
    """Return points (point, 3) all over the volume."""
    steps = (np.arange(_STEPS) + 0.5) / _STEPS - 0.5
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid * volume.size_m + volume.center_m


def _widest(camera: Camera) -> float:
    """Return how far from the axis, at depth 1, the image's border looks."""
    width, height = camera.width, camera.height
    columns, rows = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    border = [(column, row) for column in columns for row in (0, height - 1)]
    border += [(column, row) for row in rows for column in (0, width - 1)]
    plane = cv2.undistortPoints(
        np.array(border, np.float64)[:, None], camera.intrinsics, camera.distortion
    )
    return float(np.linalg.norm(plane.reshape(-1, 2), axis=1).max())


def _distance_fault(cameras: Sequence[Camera], volume: Volume, unit_m: float) -> str | None:
    """Return which unit would fit where the cameras are far too far away, or all too near."""
    centers = np.array([camera.center_m for camera in cameras])
    away = np.linalg.norm(centers - volume.center_m, axis=1)
    focal = np.array(
        [camera.intrinsics[0, 0] / math.hypot(camera.width, camera.height) for camera in cameras]
    )
    with np.errstate(divide="ignore", over="ignore"):
        far = bool(np.median(focal * volume.diagonal_m / away) < _SMALLEST)
    near = bool((abs(centers - volume.center_m) < np.array(volume.size_m) / 2).all())
    if not far and not near:
        return None
    distance = max(float(np.median(away)), 1e-9)
    factors = [10.0**power for power in (-3, -2, -1, 1, 2, 3)]
    factor = min(factors, key=lambda factor: _misfit(centers * factor, volume))
    fitting = [name for name, value in _UNITS.items() if np.isclose(value, unit_m * factor)]
    advice = (
        f'if the calibration is in {fitting[0]}, write unit = "{fitting[0]}" under [video]'
        if fitting
        else "correct the unit of the calibration, or [volume]"
    )
    return (
        f"the cameras stand {distance:.3g} m from the volume's center, "
        f"{'which is too far to see' if far else 'which is inside'} a volume of "
        f"{volume.diagonal_m:.3g} m; {advice}"
    )


def _misfit(centers: NDArray[np.float64], volume: Volume) -> float:
    """Return how unusual the distance of cameras from a volume is: 0 where it is the diagonal."""
    distance = float(np.median(np.linalg.norm(centers - volume.center_m, axis=1)))
    return abs(math.log(max(distance, 1e-9) / volume.diagonal_m))


def _hint(cameras: Sequence[Camera], volume: Volume, shares: Sequence[float]) -> str | None:
    """Return what would let the cameras see the volume: another axis up, or one in the volume."""
    now = float(np.mean(shares))
    x, y, z = volume.center_m
    width, height, depth = volume.size_m
    swapped = Volume((x, z, -y), (width, depth, height), volume.voxel_m)
    if _better(np.mean([share_seen(camera, swapped) for camera in cameras]), now):
        return (
            f"[volume] is written with y up: center_m = {[x, z, -y]} and size_m = "
            f"{[width, depth, height]} would be seen"
        )
    for axis in Y_UP_FROM:
        turned = [turn_y_up(camera, axis) for camera in cameras]
        if _better(np.mean([share_seen(camera, volume) for camera in turned]), now):
            return (
                "the world seems to lie on its side: correct `up` under [video], or if it is "
                "right, [volume], which is written with y up"
            )
    return None


def _better(share: np.floating, now: float) -> bool:
    return bool(share > 0.5 and share > 2 * now)
