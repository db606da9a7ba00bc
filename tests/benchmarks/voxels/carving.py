"""Measure carving and coloring against plain loops, whole arrays and Open3D, in one run.

    python -m tests.benchmarks.voxels.carving [--json FILE] [--data FOLDER]

The true silhouettes of the shared captures, before their cameras; without them a generated
figure. One thread is measured by its processor time, the best of several, turn by turn; two
by the clock. Open3D is measured where it is installed (the extra `peers`).
"""

import argparse
import importlib
import json
import sys
import time
import tomllib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numcodecs
import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.geometry.projection import Projection
from tasks.geometry.voxels import VoxelGrid, VoxelRuns, decode_runs, join_runs, volume_grid
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.coloring import ColoringSettings, color_surface
from tests.benchmarks.history import keep_ratios
from tests.benchmarks.recordings import data_folder
from tests.benchmarks.voxels.peers import (
    MIN_CAMERAS,
    lens_of,
    project_whole_arrays,
    visit_every_voxel,
)

SETTINGS = CarvingSettings(min_cameras=MIN_CAMERAS)
NAMES = ("plain", "kimono", "spin", "martial")
FRAME = 60


@dataclass(frozen=True)
class Scene:
    """A capture as the benchmark needs it."""

    name: str
    silhouettes: NDArray[np.bool_]
    projection: Projection
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    folder: Path | None = None


def main() -> None:
    """Run every benchmark and print one table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("--data", type=Path, default=data_folder())
    options = parser.parse_args()
    scenes = [load(options.data / "captures" / name) for name in NAMES]
    scenes = [scene for scene in scenes if scene] or [generate()]
    scene = scenes[min(1, len(scenes) - 1)]
    figures = [*peer_rows(scene), *peer_rows(straighten(scene))]
    for scene in scenes:
        figures += scene_rows(scene)
    for line in [("what", "shosa", "peer", "ratio", "target"), *figures]:
        sys.stdout.write("{:66} {:>10} {:>10} {:>8}  {}\n".format(*line))
    keep_ratios("carving", {line[0]: float(line[3]) for line in figures if line[3]})
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


def load(folder: Path) -> Scene | None:
    """Return a shared capture with its true silhouettes, or None where it is absent."""
    truth = folder.with_name(folder.name + "_truth.npz")
    if not truth.exists():
        return None
    tables = tomllib.loads((folder / "calibration.toml").read_text())
    cameras = [table for name, table in tables.items() if name != "metadata"]
    rotations = [cv2.Rodrigues(np.array(camera["rotation"]))[0] for camera in cameras]
    projection = Projection(
        np.stack(
            [
                np.column_stack([rotation, camera["translation"]])
                for rotation, camera in zip(rotations, cameras, strict=True)
            ]
        ),
        np.array([camera["matrix"] for camera in cameras]),
        np.array([camera["distortions"] for camera in cameras]),
        np.array([camera["size"] for camera in cameras]),
    )
    with np.load(truth) as arrays:
        columns = int(arrays["mask_shape"][-1])
        silhouettes = np.unpackbits(arrays["masks"], axis=-1)[..., :columns].astype(np.bool_)
    volume = tomllib.loads((folder / "capture.toml").read_text())["volume"]
    return Scene(folder.name, silhouettes, projection, volume["center_m"], volume["size_m"], folder)


def generate() -> Scene:
    """Return a figure of balls before a ring of eight cameras."""
    share = np.linspace(0, 1, 40)[:, None]
    limbs = [
        ((0, 0.8, 0), (0, 1.55, 0), 0.15),
        ((0.2, 1.35, 0), (0.72, 1.2, 0.25), 0.055),
        ((-0.2, 1.35, 0), (-0.6, 1.6, -0.25), 0.055),
        ((0.1, 0.75, 0), (0.25, 0.1, 0.1), 0.075),
        ((-0.1, 0.75, 0), (-0.2, 0.1, -0.2), 0.075),
    ]
    points = np.concatenate([a + share * np.subtract(b, a) for a, b, _ in limbs])
    radii = np.repeat([radius for *_, radius in limbs], 40)
    inner = np.array([[350.0, 0, 159.5], [0, 350.0, 119.5], [0, 0, 1]])
    poses, silhouettes = [], np.zeros((1, 8, 240, 320), np.uint8)
    for c in range(8):
        angle = 2 * np.pi * (c + 0.3) / 8
        eye = np.array([3.3 * np.cos(angle), 1.0 + 1.2 * (c % 2), 3.3 * np.sin(angle)])
        ahead = ([0, 1, 0] - eye) / np.linalg.norm([0, 1, 0] - eye)
        right = np.cross(ahead, [0, 1.0, 0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        poses.append(np.column_stack([rotation, -rotation @ eye]))
        before = points @ rotation.T - rotation @ eye
        for (x, y, z), radius in zip(before, radii, strict=True):
            place = (round(350 * x / z + 159.5), round(350 * y / z + 119.5))
            cv2.circle(silhouettes[0, c], place, round(350 * radius / z), 1, -1)
    projection = Projection(
        np.stack(poses),
        np.repeat(inner[None], 8, axis=0),
        np.zeros((8, 0)),
        np.full((8, 2), (320, 240)),
    )
    frames = np.repeat(silhouettes.astype(np.bool_), 10, axis=0)
    return Scene("generated", frames, projection, (0, 1.0, 0), (2.0, 2.0, 2.0))


def straighten(scene: Scene) -> Scene:
    """Return a scene whose cameras have no distortion: less work for everybody."""
    projection = Projection(
        scene.projection.camera_from_world,
        scene.projection.intrinsics,
        np.zeros((scene.projection.cameras, 0)),
        scene.projection.image_size,
    )
    return replace(scene, name=f"{scene.name} without lens", projection=projection)


def peer_rows(scene: Scene) -> list[tuple[str, ...]]:
    """Compare one frame in a cube of 200 voxels a side with the peers, each result checked."""
    grid = volume_grid(scene.center_m, (2.0, 2.0, 2.0), 0.01)
    silhouettes = scene.silhouettes[min(FRAME, len(scene.silhouettes) - 1)]
    lens = lens_of(scene.projection)
    wanted = np.empty(grid.shape, np.bool_)

    def carve() -> VoxelRuns:
        return carve_visual_hull(silhouettes, scene.projection, grid, SETTINGS)

    def loop() -> None:
        visit_every_voxel(silhouettes, lens, np.array(grid.origin_m), grid.voxel_m, wanted)

    rows, ours, plain = [], np.inf, np.inf
    for _ in range(4):
        ours, plain = min(ours, seconds(carve, 8)), min(plain, seconds(loop, 1))
    hull = decode_runs(carve(), 0)
    assert np.array_equal(hull, wanted), "carving differs from plain numba"
    what = f"carving 200^3, 8 x 320x240, {scene.name}"
    rows.append(row(f"{what} : plain numba", ours, plain, ">= 15"))
    started = time.thread_time()
    arrays = project_whole_arrays(silhouettes, scene.projection, grid)
    slow = time.thread_time() - started
    assert np.array_equal(hull, arrays), "carving differs from numpy"
    rows.append(row(f"{what} : numpy", ours, slow, ">= 200"))
    return rows + open3d_rows(what, ours, silhouettes, scene, grid)


def scene_rows(scene: Scene) -> list[tuple[str, ...]]:
    """Measure a whole capture: two voxel sizes, two threads, bytes, and coloring."""
    coarse = volume_grid(scene.center_m, scene.size_m, 0.01)
    fine = volume_grid(scene.center_m, scene.size_m, 0.005)
    some = scene.silhouettes[:: max(1, len(scene.silhouettes) // 8)]
    times = {}
    for grid in (coarse, fine):
        frames = [
            seconds(lambda s=s, g=grid: carve_visual_hull(s, scene.projection, g, SETTINGS), 3)
            for s in some
        ]
        times[grid.voxel_m] = float(np.mean(frames))
        wanted = np.empty(grid.shape, np.bool_)
        lens = lens_of(scene.projection)
        visit_every_voxel(some[0], lens, np.array(grid.origin_m), grid.voxel_m, wanted)
        hull = carve_visual_hull(some[0], scene.projection, grid, SETTINGS)
        assert np.array_equal(decode_runs(hull, 0), wanted), "carving differs from plain numba"
    shape = "x".join(str(n) for n in coarse.shape)
    ratio = times[0.005] / times[0.01]
    rows = [
        (
            f"carving {scene.name}, {shape}, 1 cm : 5 mm",
            f"{1e3 * times[0.01]:.1f} ms",
            f"{1e3 * times[0.005]:.1f} ms",
            f"{ratio:.2f}",
            "<= 5",
        )
    ]
    started = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        frames = list(
            pool.map(
                lambda s: carve_visual_hull(s, scene.projection, coarse, SETTINGS),
                scene.silhouettes,
            )
        )
    rate = len(frames) / (time.perf_counter() - started)
    rows.append((f"carving {scene.name}, 1 cm, two threads", f"{rate:.0f} f/s", "", "", ""))
    runs = join_runs(frames)
    stored = sum(
        len(numcodecs.Zstd(level=3).encode(array))
        for array in (runs.start, runs.length, runs.offset)
    )
    dense = len(frames) * int(np.prod(coarse.shape))
    rows.append(
        (
            f"occupancy {scene.name}, {len(frames)} frames, zstd : dense",
            f"{stored / 1e6:.2f} MB",
            f"{dense / 1e6:.0f} MB",
            f"1/{dense / stored:.0f}",
            "<= 1/500",
        )
    )
    return rows + coloring_rows(scene, coarse)


def coloring_rows(scene: Scene, grid: VoxelGrid) -> list[tuple[str, ...]]:
    """Measure coloring of some frames from the videos of a capture."""
    if scene.folder is None:
        return []
    chosen = range(10, len(scene.silhouettes), 40)
    images = read_frames(scene.folder, set(chosen))
    spent, without = [], []
    for frame in chosen:
        silhouettes = scene.silhouettes[frame]
        hull = carve_visual_hull(silhouettes, scene.projection, grid, SETTINGS)

        def color(hull: VoxelRuns = hull, frame: int = frame) -> Any:
            return color_surface(
                hull,
                grid,
                images[frame],
                scene.silhouettes[frame],
                scene.projection,
                ColoringSettings(),
            )

        spent.append(seconds(color, 3))
        without.append((color().camera == NO_CAMERA).mean())
    return [
        (f"coloring {scene.name}, 1 cm", f"{1e3 * np.mean(spent):.1f} ms", "", "", ""),
        (
            f"surface voxels without own color, {scene.name}",
            f"{100 * np.mean(without):.2f} %",
            "",
            "",
            "<= 5 %",
        ),
    ]


def read_frames(folder: Path, chosen: set[int]) -> dict[int, NDArray[np.uint8]]:
    """Return the images (camera, row, column, rgb) of some frames of a capture's videos."""
    images: dict[int, list[Any]] = {frame: [] for frame in chosen}
    for path in sorted((folder / "videos").glob("*.mp4")):
        video = cv2.VideoCapture(str(path))
        for frame in range(max(chosen) + 1):
            good, image = video.read()
            assert good, f"{path} ends before frame {frame}"
            if frame in chosen:
                images[frame].append(image[..., ::-1])
    return {frame: np.stack(views) for frame, views in images.items()}


def seconds(work: Callable[[], Any], rounds: int) -> float:
    """Return the least processor time of this thread, once compiled."""
    work()
    best = np.inf
    for _ in range(rounds):
        started = time.thread_time()
        work()
        best = min(best, time.thread_time() - started)
    return best


def row(what: str, ours: float, peer: float, target: str) -> tuple[str, ...]:
    """Return a line of the table, times in ms."""
    return what, f"{1e3 * ours:.1f} ms", f"{1e3 * peer:.0f} ms", f"{peer / ours:.1f}", target


def open3d_rows(
    what: str, ours: float, silhouettes: NDArray[np.bool_], scene: Scene, grid: VoxelGrid
) -> list[tuple[str, ...]]:
    """Compare with Open3D, which keeps a voxel when any of its corners is in a silhouette.

    It knows no distortion and tests corners, so that its hull holds ours without distortion:
    the share of ours that it holds is printed.
    """
    try:
        o3d = importlib.import_module("open3d")
    except ImportError:
        return [(f"{what} : no Open3D", f"{1e3 * ours:.1f} ms", "", "", "")]
    size = [n * grid.voxel_m for n in grid.shape]
    corner = np.array(grid.origin_m) - grid.voxel_m / 2
    started = time.thread_time()
    voxels = o3d.geometry.VoxelGrid.create_dense(corner, [0, 0, 0], grid.voxel_m, *size)
    for c, silhouette in enumerate(silhouettes):
        camera = o3d.camera.PinholeCameraParameters()
        columns, rows = (int(n) for n in scene.projection.image_size[c])
        camera.intrinsic = o3d.camera.PinholeCameraIntrinsic(
            columns, rows, scene.projection.intrinsics[c]
        )
        camera.extrinsic = np.vstack([scene.projection.camera_from_world[c], [0, 0, 0, 1]])
        image = o3d.geometry.Image(silhouette.astype(np.float32))
        voxels.carve_silhouette(image, camera, keep_voxels_outside_image=False)
    spent = time.thread_time() - started
    hull = decode_runs(
        carve_visual_hull(silhouettes, straighten(scene).projection, grid, SETTINGS), 0
    )
    index = np.array([voxel.grid_index for voxel in voxels.get_voxels()])
    theirs = np.zeros(grid.shape, np.bool_)
    theirs[tuple(index.T)] = True
    inside = (hull & theirs).sum() / hull.sum()
    return [row(f"{what} : Open3D ({inside:.1%})", ours, spent, "")]


if __name__ == "__main__":
    main()
