"""What a camera layout would see, before cameras are hung: shares of the volume, and the hull.

The visual hull of a performer is larger than the performer, and larger the fewer cameras carve it
(Laurentini 1994). How much larger is measured on a generated performer: the volume of the hull of
a layout over that of the hull of very many cameras all around, which no layout can fall below.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.camera import Camera
from storage.formats.capture.capture_toml import Volume
from storage.schema import JOINTS
from tasks.capture.films import projection_of
from tasks.engine.threads import side_by_side
from tasks.geometry.projection import project_points
from tasks.geometry.voxels import VoxelGrid, count_voxels, volume_grid, voxel_centers
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48, radio_arms, radio_knees, radio_sides
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.performances import TK, generate_performance
from tasks.studio.stage.bodies import BodySurface, pose_surface
from tasks.studio.stage.rasterization import draw_triangles, project_bent

_GRID_M = 0.05  # of the points that say how much of the volume is seen
_POSES = 6  # of a performer that stands about in the volume; each is carved once
_AROUND = 40  # cameras of the hull that is compared with


@dataclass(frozen=True, eq=False)
class LayoutReport:
    """What a layout of cameras sees."""

    names: tuple[str, ...]
    seen_by: NDArray[np.float64]
    """(camera + 1,) share of the volume that exactly k cameras see."""
    share: NDArray[np.float64]
    """(camera,) share of the volume that each camera sees."""
    pixel_m: NDArray[np.float64]
    """(camera,) metres that a pixel covers at the middle of the volume; NaN behind it."""
    excess: NDArray[np.float64]
    """(pose,) volume of the hull over that of very many cameras, less 1: 0.3 is 30 % too much;
    the first pose has stretched arms."""
    excess_without: NDArray[np.float64]
    """(camera,) the mean of that over the poses where one camera fails; NaN where fewer are left
    than carving needs."""
    lost: NDArray[np.float64]
    """(pose,) share of the performer that the hull lacks: limbs outside the volume."""


def judge_layout(
    cameras: Sequence[Camera], volume: Volume, *, voxel_m: float = 0.02
) -> LayoutReport:
    """Return what cameras would see of a volume, and of a performer in its middle.

    Parameters
    ----------
    cameras
        Metres, y up, image sizes known; three or more.
    volume
        What is to be observed.
    voxel_m
        Edge of the voxels that hulls are measured in.

    Raises
    ------
    ValueError
        If there are fewer than three cameras.
    """
    rule = CarvingSettings()
    if len(cameras) < rule.min_cameras:
        raise ValueError(
            f"{len(cameras)} cameras carve nothing: {rule.min_cameras} or more are wanted"
        )
    coarse = volume_grid(volume.center_m, volume.size_m, _GRID_M)
    points = voxel_centers(coarse, np.argwhere(np.ones(coarse.shape, np.bool_)))
    pixel, _ = project_points(points, projection_of(cameras))
    sees = np.isfinite(pixel[..., 0])
    count = np.bincount(sees.sum(axis=0), minlength=len(cameras) + 1)
    middle = np.array([volume.center_m])
    _, depth = project_points(middle, projection_of(cameras))
    focal = np.array([camera.intrinsics[0, 0] for camera in cameras])
    excess, without, lost = _judge_hulls(cameras, volume, voxel_m, rule)
    return LayoutReport(
        tuple(camera.name for camera in cameras),
        count / sees.shape[1],
        sees.mean(axis=1),
        np.where(depth[:, 0] > 0, depth[:, 0] / focal, np.nan),
        excess,
        without,
        lost,
    )


def _judge_hulls(
    cameras: Sequence[Camera], volume: Volume, voxel_m: float, rule: CarvingSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the excess of the hulls, without each camera, and what they lack."""
    surface = _performer(volume)
    cameras = [replace(camera, distortion=np.zeros(0)) for camera in cameras]
    grid = volume_grid(volume.center_m, volume.size_m, voxel_m)
    low, high = surface.vertex.min(axis=(0, 1)), surface.vertex.max(axis=(0, 1))
    room = volume_grid((low + high) / 2, high - low + 4 * voxel_m, voxel_m)
    around = [
        *generate_cameras(_ring(_AROUND - 8), center_m=(low + high) / 2),
        *generate_cameras(_ring(0, overhead=8), center_m=(low + high) / 2),
    ]
    best = _volumes(around, surface, room, rule, None)
    inside = _volumes(around, surface, grid, rule, None)
    found = _volumes(cameras, surface, grid, rule, None)
    without = np.full(len(cameras), np.nan)
    if len(cameras) > rule.min_cameras:
        for n in range(len(cameras)):
            fewer = _volumes(cameras, surface, grid, rule, n)
            without[n] = float(np.mean(fewer / inside)) - 1.0
    return found / inside - 1.0, without, 1.0 - np.minimum(inside / best, 1.0)


def _volumes(
    cameras: Sequence[Camera], surface: BodySurface, grid: VoxelGrid, rule: CarvingSettings,
    failed: int | None,
) -> NDArray[np.float64]:  # fmt: skip
    """Return the volume of the hull in each pose, voxels; one at least."""
    kept = [camera for n, camera in enumerate(cameras) if n != failed]
    projection = projection_of(kept)
    rows = max(camera.height for camera in kept)
    columns = max(camera.width for camera in kept)

    def carve(pose: int) -> int:
        silhouettes = np.zeros((len(kept), rows, columns), np.bool_)
        for silhouette, camera in zip(silhouettes, kept, strict=True):
            _draw_silhouette(silhouette, camera, surface, pose)
        return int(count_voxels(carve_visual_hull(silhouettes, projection, grid, rule))[0])

    return np.maximum(side_by_side(carve, range(len(surface.vertex))), 1).astype(np.float64)


def _draw_silhouette(
    silhouette: NDArray[np.bool_], camera: Camera, surface: BodySurface, pose: int
) -> None:
    """Draw what a camera with a straight lens would see of the performer."""
    shape = (camera.height, camera.width)
    placed = np.column_stack([camera.rotation, camera.translation])
    pixel, depth = project_bent(surface.vertex[pose], placed, camera.intrinsics, np.zeros(0))
    nearest, seen = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
    draw_triangles(pixel, depth, surface.triangle, nearest, seen)
    silhouette[: shape[0], : shape[1]] = seen >= 0


def _performer(volume: Volume) -> BodySurface:
    """Return a performer in the middle of the volume: arms stretched, and some of a dance."""
    movements = [radio_arms(), radio_sides(), radio_knees(), okuri48()]
    danced = generate_performance(movements, TK, rate_hz=30.0).position
    chosen = np.linspace(len(danced) * 0.1, len(danced) * 0.9, _POSES - 1).round().astype(int)
    position = np.concatenate([stretch_arms_first(danced[:1], 30.0)[:1], danced[chosen]])
    hips = position[:, [JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=1)
    position = position - (hips * [1, 0, 1])[:, None]
    position += np.array([volume.center_m[0], 0.0, volume.center_m[2]])
    return pose_surface(dict(zip(JOINTS, np.moveaxis(position, 1, 0), strict=True)))


def _ring(cameras: int, *, overhead: int = 0) -> RingSettings:
    """Return cameras around, without faults."""
    return RingSettings(
        cameras=cameras, overhead=overhead, heights_m=(0.3, 1.2, 2.2, 3.2), distortion=(0.0, 0.0),
        size=(640, 480), spread=0.0,
    )  # fmt: skip


def report_layout(report: LayoutReport) -> list[str]:
    """Return a report as lines of text."""
    lines = [f"{'camera':16} {'sees':>6} {'mm a pixel':>11} {'hull if it fails':>17}"]
    for n, name in enumerate(report.names):
        lines.append(
            f"{name:16} {report.share[n]:6.0%} {1000 * report.pixel_m[n]:11.1f} "
            f"{_percent(report.excess_without[n]):>17}"
        )
    lines += ["", "share of the volume that k cameras see:"]
    lines += [f"{k:6d} {share:7.1%}" for k, share in enumerate(report.seen_by) if share > 0]
    lines += [
        "",
        f"hull against that of {_AROUND} cameras: {_percent(float(report.excess.mean()))} on the "
        f"mean of {len(report.excess)} poses, {_percent(float(report.excess.max()))} in the worst, "
        f"{_percent(float(report.excess[0]))} with stretched arms",
    ]
    if report.lost.max() > 0.005:
        lines.append(
            f"up to {report.lost.max():.0%} of a performer in its middle is outside the volume"
        )
    return lines


def _percent(excess: float) -> str:
    return "-" if math.isnan(excess) else f"{excess:+.0%}"
