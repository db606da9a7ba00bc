"""Trouble added to captures: errors in silhouettes and calibration, fewer cameras and frames."""

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Written, read_block, write_block
from storage.formats.calibration.toml import write_calibration
from storage.formats.capture.capture import Capture, read_capture
from storage.formats.pictures.video import open_video, read_frames
from storage.formats.pictures.video_writing import write_video
from tasks.capture.films import read_films
from tasks.reconstruction.regions.pixels import take_pixels
from tests.benchmarks.bodies.runs import Voxels, make_voxels

BLOBS, RADIUS_PX = 6, (1.5, 4.0)
"""Flipped in each silhouette, half of them at its outline and half inside; a limb is 5-8 wide."""
MOVED_PX = 1.0


def spoil_silhouettes(archive: str, source: Capture, written: Written) -> Written:
    """Return a block of silhouettes with holes, bites and bumps instead of the one given.

    What was filmed in them comes along, as in the block of `extract_block`.
    """
    begun, block, place = time.monotonic(), written.block, open_archive(archive).place
    packed = read_block(place, block)["silhouette"]
    columns = source.cameras[0].width
    bits = np.unpackbits(packed, axis=-1, count=columns)
    rng = np.random.default_rng([block.start, 7])
    for frame in bits:
        for silhouette in frame:
            _flip_blobs(silhouette, rng)
    spoilt = np.packbits(bits, axis=-1)
    frames = (block.start, block.end)
    color = [
        take_pixels(silhouette, image)
        for first, films in read_films(source, *frames)
        for time_, images in enumerate(zip(*films, strict=True), first - block.start)
        for silhouette, image in zip(spoilt[time_], images, strict=True)
    ]
    arrays = {"silhouette": spoilt, "color": np.concatenate(color)}
    return write_block(place, f"{block.path}.spoilt", frames, arrays, begun)


def _flip_blobs(silhouette: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Flip disks of some pixels in place, at the outline (to either side) and inside."""
    inner = cv2.erode(silhouette, np.ones((3, 3), np.uint8))
    for number in range(BLOBS):
        among = np.argwhere(inner if number % 2 else silhouette > inner)
        if not len(among):
            continue
        row, column = among[rng.integers(len(among))]
        disk = np.zeros_like(silhouette)
        radius = rng.uniform(*RADIUS_PX)
        cv2.circle(disk, (int(column), int(row)), round(radius), 1, -1)
        if number % 2 or rng.random() < 0.5:
            silhouette &= ~disk & 1
        else:
            silhouette |= disk


def copy_without_camera(capture: Path, into: Path) -> Path:
    """Write a capture with the third camera missing."""
    shutil.copytree(capture, into)
    source = read_capture(capture)
    gone = source.cameras[2].name
    write_calibration(
        into / source.calibration.name,
        [camera for camera in source.cameras if camera.name != gone],
    )
    for folder in ("videos", "background"):
        for path in (into / folder).glob(f"{gone}.*"):
            path.unlink()
    return into


def copy_bent(capture: Path, into: Path) -> Path:
    """Write a capture whose principal points are a pixel off, each its own way."""
    shutil.copytree(capture, into)
    source = read_capture(capture)
    angles = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, len(source.cameras))
    bent = []
    for camera, angle in zip(source.cameras, angles, strict=True):
        intrinsics = camera.intrinsics.copy()
        intrinsics[:2, 2] += MOVED_PX * np.array([np.cos(angle), np.sin(angle)])
        bent.append(replace(camera, intrinsics=intrinsics))
    write_calibration(into / source.calibration.name, bent)
    return into


def copy_half_rate(capture: Path, into: Path) -> Path:
    """Write a capture with every second frame."""
    shutil.copytree(capture, into)
    source = read_capture(capture)
    for path in source.videos:
        frames = read_frames(open_video(path), 0, source.frames)[::2]
        film = into / path.relative_to(capture)
        film.unlink()
        write_video(film.with_suffix(".mp4"), iter(frames), source.fps / 2.0)
    said = into / "capture.toml"
    lines = [
        f"fps = {source.fps / 2.0}" if line.split("=")[0].strip() == "fps" else line
        for line in said.read_text(encoding="utf-8").splitlines()
    ]
    said.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return into


COPIES: dict[str, Callable[[Path, Path], Path]] = {
    "one camera missing": copy_without_camera,
    "calibration 1 px off": copy_bent,
    "half the frame rate": copy_half_rate,
}


def troubled_voxels(archive: Path, capture: Path, copies: Path) -> dict[str, Voxels]:
    """Return the voxels of a capture with each kind of trouble, and without."""
    found = {
        "none": make_voxels(archive / "none", capture),
        "silhouette noise": make_voxels(archive / "noise", capture, spoil=spoil_silhouettes),
    }
    for trouble, copy in COPIES.items():
        name = trouble.replace(" ", "-")
        (copies / name).mkdir(parents=True, exist_ok=True)
        spoilt = copies / name / capture.name
        if not spoilt.exists():
            copy(capture, spoilt)
        found[trouble] = make_voxels(archive / name, spoilt)
    return found
