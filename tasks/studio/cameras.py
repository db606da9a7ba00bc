"""Generated cameras in a ring around a performer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Lt
from numpy.typing import NDArray

from storage.formats.calibration.camera import Camera
from tasks.engine.settings import CountOrNone, NotNegative, Positive, check_ranges
from tasks.studio.dancing.limbs import unit


@dataclass(frozen=True)
class RingSettings:
    """Where the cameras of a generated capture stand, and what they are."""

    cameras: CountOrNone = 8
    """Cameras around the performer, evenly. The speed of digitizing is promised for so
    many."""
    overhead: CountOrNone = 0
    """More of them that look down from above. None, as in most studios."""
    radius_m: Positive = 4.2
    """Distance from the middle of the volume, over the floor. A performer with stretched arms is
    whole in each image; not measured."""
    heights_m: tuple[float, ...] = (1.2, 2.4)
    """Heights above the floor, in turn. Chosen, not measured."""
    overhead_m: Positive = 4.5
    """Height of the cameras above. Chosen, not measured."""
    field_of_view: Annotated[float, Gt(0), Lt(math.pi)] = 0.85
    """Angle that the image's width covers [rad]. Chosen with the radius; not measured."""
    distortion: tuple[float, float] = (-0.08, 0.01)
    """OpenCV's k1 and k2 of the lens. Chosen, not measured: straight lines bend visibly."""
    size: tuple[int, int] = (320, 240)
    """Columns and rows of an image [px]. The size that the speed of digitizing is
    promised for."""
    spread: NotNegative = 0.02
    """How much places, lenses and image centers differ from camera to camera [share]. Cameras hung
    by hand differ; chosen, not measured."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


def generate_cameras(
    settings: RingSettings = RingSettings(),
    *,
    center_m: Sequence[float] | NDArray[np.float64] = (0.0, 1.0, 0.0),
    seed: int = 0,
) -> tuple[Camera, ...]:
    """Return cameras in a ring that look at a point, named cam1, cam2 and so on.

    Parameters
    ----------
    settings : RingSettings
        Places and lenses.
    center_m : (x, y, z)
        What they look at, metres; the ring stands around it on the floor y = 0.
    seed : int
        Of the differences from camera to camera.

    Raises
    ------
    ValueError
        If there is no camera.
    """
    count = settings.cameras + settings.overhead
    if min(settings.cameras, settings.overhead) < 0 or count == 0:
        raise ValueError(
            f"{settings.cameras} cameras around and {settings.overhead} above film nothing; "
            "ask for at least one"
        )
    rng = np.random.default_rng([seed, 1])
    return tuple(_hang_camera(number, settings, np.array(center_m), rng) for number in range(count))


def _hang_camera(
    number: int, settings: RingSettings, center: NDArray[np.float64], rng: np.random.Generator
) -> Camera:
    """Return one camera of a ring."""
    above = number - settings.cameras
    heights, radius = settings.heights_m, settings.radius_m
    angle = 2.0 * np.pi * (number + 0.3) / max(settings.cameras, 1)
    height = heights[number % len(heights)]
    if above >= 0:
        angle = 2.0 * np.pi * above / settings.overhead
        height, radius = settings.overhead_m, 0.0 if settings.overhead == 1 else 0.25 * radius
    differs = 1.0 + settings.spread * rng.uniform(-1.0, 1.0, 6)
    place = np.array([center[0], 0.0, center[2]]) + differs[0] * np.array(
        [radius * np.sin(angle), height, radius * np.cos(angle)]
    )
    ahead = unit(center - place)
    upright = np.array([0.0, 1.0, 0.0] if abs(ahead[1]) < 0.99 else [0.0, 0.0, -1.0])
    right = unit(np.cross(ahead, upright))
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    focal = settings.size[0] / 2.0 / np.tan(settings.field_of_view / 2.0)
    middle = differs[3:5] * (np.array(settings.size) - 1.0) / 2.0
    high = focal * differs[1] * (1.0 + 0.2 * (differs[2] - 1.0))
    intrinsics = np.array(
        [[focal * differs[1], 0.0, middle[0]], [0.0, high, middle[1]], [0.0, 0.0, 1.0]]
    )
    return Camera(
        f"cam{number + 1}",
        settings.size,
        intrinsics,
        np.array([*settings.distortion, 0.0, 0.0]),
        rotation,
        -rotation @ place,
    )
