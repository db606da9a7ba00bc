"""Tell a face from a hand by the colors of the head around it: hair, or what is worn there.

A hand that passes before the face shows as much skin, and moves on more smoothly than a face that
is half hidden. But no hair is around it. What colors the head has beside skin is learned in the
frames of the initial model; where clothes have them, too, they tell little.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio
from tasks.body.anatomy.skin import SurfaceFrame, separability
from tasks.body.extremities.candidates import MOST_OWN
from tasks.body.extremities.feet import KNOWN_FROM
from tasks.engine.kernels import njit

Floats = NDArray[np.float64]

LEAST_MASS = 1.0
"""Sum of the ratios around the face below which nothing of the head shows but skin [nats]. A few
voxels; chosen, not measured."""


@dataclass(frozen=True, eq=False)
class HairColors:
    """What colors the head has beside skin, and clothes have not."""

    ratio: Floats
    """(cell of `anatomy.colors`,) logarithm of how much likelier a color is on the head; 0 where it
    is less likely."""

    known: float
    """Share of the head's voxels that are recognized less that of the others."""

    mass: float
    """The sum of the ratios around the face in the first frames."""


def learn_hair(
    frames: Sequence[tuple[SurfaceFrame, NDArray[np.bool_]]], face: Floats, radius_m: float
) -> HairColors | None:
    """Return the colors of the head; None where nothing of it shows but skin.

    Parameters
    ----------
    frames : sequence of (SurfaceFrame, (voxel,) bool)
        Of the initial model, or near it, with what is skin.
    face : (3,) float64
        Where the face is in them, m.
    radius_m
        Of the ball around a face that holds the front half of the head.
    """
    heads, others = [], []
    for frame, skin in frames:
        told = ~skin & (frame.camera != NO_CAMERA)
        near = np.linalg.norm(frame.center - face, axis=1) < radius_m
        cell = color_cells(frame.color)
        heads.append(cell[told & near & (frame.center[:, 1] > face[1])])
        others.append(cell[told & ~near])
    head, other = np.concatenate(heads), np.concatenate(others)
    if not len(head) or not len(other):
        return None
    ratio = np.clip(log_ratio(count_colors(head), count_colors(other)), 0.0, MOST_OWN)
    known = separability(ratio, head, other, least=KNOWN_FROM)
    mass = np.mean([_sum_around(frame, face[None], ratio, radius_m)[0] for frame, _ in frames])
    return HairColors(ratio, known, float(mass)) if mass > LEAST_MASS else None


def hair_around(frame: SurfaceFrame, face: Floats, colors: HairColors, radius_m: float) -> Floats:
    """Return how much hair is around places (place, 3), m; 1 is as much as around a face."""
    return _sum_around(frame, face, colors.ratio, radius_m) / colors.mass


def _sum_around(frame: SurfaceFrame, place: Floats, ratio: Floats, radius_m: float) -> Floats:
    """Return (place,) the sum of the ratios of the voxels around places."""
    found = np.zeros(len(place))
    cell = color_cells(frame.color)
    _add_near(frame.center, frame.camera, cell, ratio, place, radius_m, found)
    return found


@njit(cache=True, nogil=True)
def _add_near(
    center: Any, camera: Any, cell: Any, ratio: Any, place: Any, radius: Any, found: Any
) -> None:
    """Add the ratios of voxels with a color of their own that are nearer than a radius."""
    for n in range(len(center)):
        own = ratio[cell[n]]
        if own <= 0.0 or camera[n] == NO_CAMERA:
            continue
        for k in range(len(place)):
            x, y, z = (
                center[n, 0] - place[k, 0],
                center[n, 1] - place[k, 1],
                center[n, 2] - place[k, 2],
            )
            if x * x + y * y + z * z < radius * radius:
                found[k] += own
