"""One camera of a capture, whatever file it was read from: x = K (R X + t).

Metres, right-handed, y up; pixel centers at integers; distortion as OpenCV defines it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_COEFFICIENTS = 8
_LARGEST_SIDE = 100_000

Y_UP_FROM = {
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-x": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-y": np.diag([1.0, -1.0, -1.0]),
    "-z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""The rotation into a y-up world, by the axis that points up."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera; what is given is checked, copied and never changes.

    Raises
    ------
    ValueError
        All that is wrong with the numbers, at once.
    """

    name: str
    """As its video is called, without the suffix."""
    size: tuple[int, int] | None
    """Width and height of the image in pixels; None where the calibration does not say."""
    intrinsics: NDArray[np.float64]
    """(3, 3) px: (fx, skew, cx), (0, fy, cy), (0, 0, 1)."""
    distortion: NDArray[np.float64]
    """k1, k2, p1, p2, k3, k4, k5, k6: the first 0, 4, 5 or 8 of them, the rest being 0."""
    rotation: NDArray[np.float64]
    """(3, 3) from the world's axes to the camera's: x right, y down, z ahead."""
    translation: NDArray[np.float64]
    """(3,) m: where the world's origin is, in the camera's axes."""

    def __post_init__(self) -> None:
        faults = _name_faults(self.name) + _size_faults(self.size)
        for field, shape in (("intrinsics", (3, 3)), ("rotation", (3, 3)), ("translation", (3,))):
            array = np.array(getattr(self, field), np.float64)
            faults += _array_faults(field, array, shape)
            _keep(self, field, array)
        distortion = np.array(self.distortion, np.float64)
        faults += _distortion_faults(distortion)
        if not faults:
            faults = _intrinsics_faults(self.intrinsics) + _rotation_faults(self.rotation)
        if faults:
            raise ValueError("; ".join(faults))
        _keep(self, "distortion", _shortest(distortion))

    @property
    def width(self) -> int:
        """Columns of the image; a ValueError where the size is not known."""
        return self._known_size()[0]

    @property
    def height(self) -> int:
        """Rows of the image; a ValueError where the size is not known."""
        return self._known_size()[1]

    @property
    def center_m(self) -> NDArray[np.float64]:
        """(3,) where the camera stands."""
        return -self.rotation.T @ self.translation

    def _known_size(self) -> tuple[int, int]:
        if self.size is None:
            raise ValueError(f"the image size of camera {self.name!r} is not known; give it one")
        return self.size


def turn_y_up(camera: Camera, up: str) -> Camera:
    """Return a camera in a y-up world, from one in which `up` is the axis that points up.

    Raises
    ------
    ValueError
        Where `up` is not x, y, z, -x, -y or -z.
    """
    if up not in Y_UP_FROM:
        raise ValueError(f"up = {up!r} is no axis; {', '.join(Y_UP_FROM)} are")
    rotation = camera.rotation @ Y_UP_FROM[up].T
    return _changed(camera, rotation, camera.translation)


def scale_world(camera: Camera, factor: float) -> Camera:
    """Return the camera of a world that is `factor` times as large."""
    return _changed(camera, camera.rotation, camera.translation * factor)


def rotation_from_vector(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation about a (3,) axis by as many radians as it is long (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector if angle < 1e-8 else vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:  # the sine is the angle, to every digit
        return np.eye(3) + cross
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)


def vector_from_rotation(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3,) Rodrigues vector of a (3, 3) rotation, at most pi long.

    By way of the unit quaternion, from its largest component, so that half turns lose nothing
    (Shepperd 1978).
    """
    m = rotation
    outer = np.empty((4, 4))  # 4 q q^T, q = (w, x, y, z)
    outer[0, 0] = 1.0 + np.trace(m)
    outer[0, 1:] = outer[1:, 0] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    outer[1:, 1:] = m + m.T
    outer[[1, 2, 3], [1, 2, 3]] = 1.0 - np.trace(m) + 2.0 * np.diag(m)
    largest = int(np.argmax(np.diag(outer)))
    q = outer[largest] / np.linalg.norm(outer[largest])
    q = -q if q[0] < 0 else q
    sine = float(np.linalg.norm(q[1:]))
    if sine < 1e-12:
        return 2.0 * q[1:]
    return q[1:] / sine * (2.0 * math.atan2(sine, q[0]))


def nearest_rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation nearest to a (3, 3) matrix whose digits were rounded."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def _changed(
    camera: Camera, rotation: NDArray[np.float64], translation: NDArray[np.float64]
) -> Camera:
    return Camera(
        camera.name, camera.size, camera.intrinsics, camera.distortion, rotation, translation
    )


def _keep(camera: Camera, field: str, array: NDArray[np.float64]) -> None:
    array.flags.writeable = False
    object.__setattr__(camera, field, array)


def _shortest(distortion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients without the zeros that OpenCV would assume anyway."""
    used = int(np.flatnonzero(distortion)[-1]) + 1 if distortion.any() else 0
    shortest = np.zeros(next(count for count in (0, 4, 5, 8) if count >= used))
    shortest[:used] = distortion[:used]
    return shortest


def _name_faults(name: str) -> list[str]:
    if name and name == name.strip() and name.isprintable() and not set(name) & set("/\\"):
        return []
    return [f"the name {name!r} cannot be that of a video file; use plain letters"]


def _size_faults(size: tuple[int, int] | None) -> list[str]:
    if size is None:
        return []
    if len(size) == 2 and all(isinstance(side, int) and 0 < side <= _LARGEST_SIDE for side in size):
        return []
    return [f"the image size {size!r} is no width and height in whole pixels"]


def _array_faults(field: str, array: NDArray[np.float64], shape: tuple[int, ...]) -> list[str]:
    if array.shape != shape:
        return [f"{field} has shape {array.shape}, {shape} is wanted"]
    if not np.isfinite(array).all():
        return [f"{field} is not finite"]
    return []


def _distortion_faults(distortion: NDArray[np.float64]) -> list[str]:
    if distortion.ndim != 1:
        return [f"distortion has shape {distortion.shape}, a row of coefficients is wanted"]
    if not np.isfinite(distortion).all():
        return ["distortion is not finite"]
    if distortion[MOST_COEFFICIENTS:].any():
        return [
            f"distortion has {len(distortion)} coefficients, of which at most "
            f"{MOST_COEFFICIENTS} (k1 k2 p1 p2 k3 k4 k5 k6) can be used; calibrate again "
            "without thin prisms and tilt"
        ]
    return []


def _intrinsics_faults(intrinsics: NDArray[np.float64]) -> list[str]:
    faults = []
    if intrinsics[[1, 2, 2], [0, 0, 1]].any() or intrinsics[2, 2] != 1.0:
        faults.append(
            "the intrinsic matrix is not of the form (fx, skew, cx), (0, fy, cy), (0, 0, 1)"
        )
    if not (intrinsics[[0, 1], [0, 1]] > 0).all():
        faults.append(
            f"the focal lengths {intrinsics[0, 0]:g} and {intrinsics[1, 1]:g} are not larger than 0"
        )
    return faults


def _rotation_faults(rotation: NDArray[np.float64]) -> list[str]:
    off = float(abs(rotation @ rotation.T - np.eye(3)).max())
    if off > 1e-6:
        return [f"its rotation is no rotation matrix: R times its transpose is off by {off:.2g}"]
    if np.linalg.det(rotation) < 0:
        return ["the rotation mirrors: its axes are left-handed"]
    return []
