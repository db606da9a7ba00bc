"""Fit a body of usual proportions to a single frame, whatever its pose, facing either way.

Nothing is known of the pose, so that the fit begins at many: every heading, pair of arms and height
of the neck. The likeliest of them that face one way, and of those that face the other, are fitted
more closely. What the voxels say of the facing is how much likelier one way makes them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.bones import BONE_NUMBER, BONES, Floats, Pose, rotation_of
from tasks.body.anatomy.colors import COLORS
from tasks.body.blobs.blobs import Voxels, gather_voxels
from tasks.body.blobs.fitting import Fit, FitSettings, fit_frame
from tasks.body.blobs.samples import Surfaces, draw_samples
from tasks.body.guess.usual_body import FRONT, UsualBody
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, voxel_centers, voxel_index

LOOSE = FitSettings(foreseen=0.003)
"""How a fit is held to the pose that it begins with: hardly, for that is a guess."""

HEADINGS = 8
"""How many headings are tried. A fit turns by 22 degrees at least in a few turns."""

ARMS = ("down", "side", "front", "bent", "up")
"""The ways in which each arm is held at first."""

NECK_DROPS = (0.15, 0.27, 0.39)
"""How far the neck is below the top of the hull [statures]. Where raised hands are the top, it is
farther below."""

COARSE = 800
"""How many voxels of a frame are looked at with every start [voxels]. Chosen by eye on the shared
captures; not measured."""

FINE = 2000
"""How many are with the best starts [voxels]. As `JointMethodSettings.sample`."""

COARSE_STEPS = 5
"""Turns of the fits from every start [turns]. Chosen by eye on the shared captures; not
measured."""

FINE_STEPS = 15
"""Turns of the fits from the best ones [turns]. Chosen by eye on the shared captures; not
measured."""

COARSE_WIDENING = 2.0
"""Factor of the blobs' size at first, with every start [factor]. Chosen by eye on the shared
captures; not measured."""

FINE_WIDENING = 1.3
"""Factor of the blobs' size at first, with the best ones [factor]. Chosen by eye on the shared
captures; not measured."""

KEPT = 6
"""How many of the likeliest fits of each facing are fitted more closely. Chosen by eye on the
shared captures; not measured."""

SAME_WAY = 0.3
"""Cosine above which two bodies face the same way, and below minus which the opposite one. 73
degrees; chosen by eye on the shared captures, not measured."""

SLAB = 0.04
"""How far above and below the height of the neck voxels are its [statures]. Chosen by eye on the
shared captures; not measured."""

CAP = 0.06
"""How far below the top of the hull voxels are the head's top [statures]. Chosen by eye on the
shared captures; not measured."""

NECK_AROUND = 0.15
"""How far from the vertical of the head's top voxels are the neck's [statures]. Arms may be beyond;
chosen by eye on the shared captures, not measured."""

_NO_LOOKS = np.ones((COLORS + 1, len(BONES) + 1), np.float32)
"""The body of usual proportions has no color."""


@dataclass(frozen=True, eq=False)
class Shown:
    """The hulls of a take, and their colors."""

    hulls: Sequence[VoxelRuns]
    """A single frame each; they may be made when they are asked for."""
    grid: VoxelGrid
    surfaces: Surfaces

    def points(self, frame: int) -> Floats:
        """Return (voxel, 3) the centers of a frame's voxels, m."""
        return voxel_centers(self.grid, voxel_index(self.hulls[frame], 0))

    def sample(self, frame: int, most: int) -> Voxels:
        """Return an even sample of a frame's voxels, without colors."""
        [(index, cell)] = draw_samples([self.hulls[frame]], None, most)
        return gather_voxels(voxel_centers(self.grid, index), cell, _NO_LOOKS)

    def part(self, first: int, end: int) -> "Shown":
        """Return the frames from one to before another as a take of their own."""
        return Shown(
            [self.hulls[n] for n in range(first, end)],
            self.grid,
            lambda frame: self.surfaces(first + frame),
        )

    def surface(self, frame: int) -> tuple[Floats, NDArray[np.uint8]]:
        """Return centers, m, and colors (surface voxel, 3) of the voxels that a camera sees."""
        is_surface, color, camera = self.surfaces(frame)
        own = camera != NO_CAMERA
        return self.points(frame)[is_surface][own], color[own]


def forward(pose: Pose) -> Floats:
    """Return (3,) where the hips of a body of usual proportions look."""
    return pose.rotation[BONE_NUMBER["Waist"]] @ FRONT


def fit_both_ways(shown: Shown, frame: int, body: UsualBody) -> list[Fit]:
    """Return the best fit of a frame, and the best that faces the other way where there is one."""
    necks = _guess_necks(shown.points(frame), body.stature_m)
    coarse, fine = shown.sample(frame, COARSE), shown.sample(frame, FINE)
    found = fit_all(body, coarse, list(_starts(necks)), COARSE_STEPS, COARSE_WIDENING)
    found.sort(key=lambda fit: -fit.likelihood)
    front = forward(found[0].pose)
    ways = []
    for sign in (1, -1):
        way = [fit.pose for fit in found if sign * forward(fit.pose) @ front > SAME_WAY][:KEPT]
        if way:
            fits = fit_all(body, fine, way, FINE_STEPS, FINE_WIDENING)
            ways.append(max(fits, key=lambda fit: fit.likelihood))
    return sorted(ways, key=lambda fit: -fit.likelihood)


def fit_all(
    body: UsualBody, voxels: Voxels, starts: Sequence[Pose], steps: int, widening: float
) -> list[Fit]:
    """Return the fits of a frame that begin with each of some poses."""

    def fit(start: Pose) -> Fit:
        return fit_frame(
            body.blobs, voxels, start, start, settings=LOOSE, steps=steps, widening=widening
        )

    return [fit(start) for start in starts]


def _starts(necks: Sequence[Floats]) -> Iterator[Pose]:
    """Yield the poses that fits begin with: every heading, every pair of arms, every neck."""
    arms = {kind: [_arm(out, kind) for out in (-1.0, 1.0)] for kind in ARMS}
    for turn, right, left, neck in product(range(HEADINGS), ARMS, ARMS, necks):
        heading = rotation_of(np.array([0.0, 2.0 * np.pi * turn / HEADINGS, 0.0]))
        rotation = np.tile(heading, (len(BONES), 1, 1))
        for side, (upper, lower) in zip("RL", (arms[right][0], arms[left][1]), strict=True):
            rotation[BONE_NUMBER[side + "UpperArm"]] = heading @ upper
            for bone in ("ForeArm", "Hand"):
                rotation[BONE_NUMBER[side + bone]] = heading @ lower
        yield Pose(neck.copy(), rotation)


def _arm(out: float, kind: str) -> tuple[Floats, Floats]:
    """Return how upper arm and forearm are turned from straight sideways; `out` is -1 on the right.

    The angles were chosen by eye on the shared captures; not measured.
    """

    def lower(degrees: float) -> Floats:
        return rotation_of(np.radians([0.0, 0.0, -out * degrees]))

    def ahead(degrees: float) -> Floats:
        return rotation_of(np.radians([0.0, -out * degrees, 0.0]))

    return {
        "down": (lower(75.0), lower(75.0)),
        "side": (lower(10.0), lower(10.0)),
        "front": (ahead(70.0) @ lower(15.0), ahead(80.0)),
        "bent": (lower(65.0), ahead(80.0) @ lower(10.0)),
        "up": (lower(-55.0), lower(-70.0)),
    }[kind]


def _guess_necks(point: Floats, stature_m: float) -> list[Floats]:
    """Return places (3,) of the neck below the hull's top, be that a head's or a hand's."""
    top, found = float(point[:, 1].max()), []
    for drop in NECK_DROPS:
        height = top - drop * stature_m
        slab = point[abs(point[:, 1] - height) < SLAB * stature_m]
        if drop == NECK_DROPS[0]:
            cap = np.median(point[point[:, 1] > top - CAP * stature_m], axis=0)
            away = np.linalg.norm((slab - cap)[:, [0, 2]], axis=1)
            near = away < NECK_AROUND * stature_m
            slab = (slab[near].mean(axis=0, keepdims=True) + cap) / 2 if near.any() else cap[None]
        if len(slab):
            neck = np.median(slab, axis=0)
            neck[1] = height
            found.append(neck)
    return found
