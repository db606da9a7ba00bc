"""Film a generated performer with generated cameras: a capture whose truth is known.

The cameras stand around a floor before a curved wall; the images have lens distortion, the
performer's shadow, sensor noise, and an exposure that flickers and drifts. Silhouettes are true
for the images as filmed: a pixel belongs to the performer when its center does.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.calibration.camera import Camera
from storage.formats.calibration.toml import write_calibration
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video_writing import write_video
from storage.schema import JOINTS
from tasks.engine.settings import Count, Positive, check_ranges
from tasks.studio.cameras import generate_cameras
from tasks.studio.stage.bodies import SEGMENTS, BodySurface, Clothes, pose_surface
from tasks.studio.stage.outer_points import outer_vertices
from tasks.studio.stage.scenes import (
    Spoilers,
    film_empty,
    film_scene,
    light_scene,
    place_shot,
)


@dataclass(frozen=True)
class FilmSettings:
    """How a performer is clothed and filmed."""

    clothes: Clothes = "fitting"
    """What the performer wears. Fitting clothes are the easier ones."""
    backdrop: Literal["green", "grey"] = "green"
    """Color of floor and walls. Green, as in a studio that is made for it."""
    spoilers: Spoilers = field(default_factory=Spoilers)
    """What keeps the images from being clean."""
    samples: Count = 3
    """Samples along each side of a pixel, an odd number. Edges are smooth enough; chosen by eye."""
    compressed: bool = True
    """Whether the images become videos; else they stay PNG files, free of loss. Real captures are
    videos."""
    voxel_m: Positive = 0.01
    """Edge of a voxel that `capture.toml` asks for. The speed of digitizing is promised for it."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class CaptureTruth:
    """What is true of a generated capture."""

    position: NDArray[np.float64]
    """(time, joint, 3), metres, joints as in `storage.schema.JOINTS`."""
    silhouette_bits: NDArray[np.uint8]
    """(time, camera, row, column / 8), packed along the columns."""
    columns: int
    """Of an image."""
    vertex: NDArray[np.float32]
    """(time, vertex, 3), metres: the body's surface, without clothes and what parts hide."""
    segment: NDArray[np.uint8]
    """(vertex,) label 1 to 11."""

    @property
    def silhouette(self) -> NDArray[np.bool_]:
        """(time, camera, row, column), clothes included."""
        return np.unpackbits(self.silhouette_bits, axis=-1, count=self.columns).astype(bool)


def film_capture(
    folder: str | Path,
    position: NDArray[np.float64],
    rate_hz: float,
    *,
    cameras: Sequence[Camera] | None = None,
    settings: FilmSettings = FilmSettings(),
    metadata: Mapping[str, str] | None = None,
    seed: int = 0,
    dress: Callable[[BodySurface], BodySurface] | None = None,
) -> CaptureTruth:
    """Write a capture folder of a generated performer, and its truth beside it.

    The truth, `<folder>_truth.npz`, holds `joints` (time, 21, 3) with `joint_names`, `verts`
    (time, vertex, 3) float16 of the body without skirt and sleeves with `vert_segment` into
    `segments`, `masks` packed along the columns with `mask_shape`, and `fps`.

    Parameters
    ----------
    folder : str or Path
        A folder that does not exist or is empty.
    position : (time, joint, 3) float64
        Metres, joints as in `storage.schema.JOINTS`; see also `stretch_arms_first`.
    rate_hz : float
        Frames a second, of the track and of the videos.
    cameras : sequence of Camera, optional
        By default the ring of `RingSettings()` around the performer; images of one size.
    settings : FilmSettings
        Clothes, backdrop and what spoils the images.
    metadata : mapping of str, optional
        The table `take` of `capture.toml`.
    seed : int
        Of noise, flicker and textures; the same seed gives the same images.
    dress : function, optional
        Returns the surface that is filmed, given the performer's: with things that are held or
        stand about (their vertices are cloth), or in other colors.

    Returns
    -------
    CaptureTruth
        What was written as truth, unrounded.

    Raises
    ------
    InputError
        If the folder holds something, or cannot be made.
    ValueError
        If the track, the rate, the samples or the cameras cannot be filmed.
    """
    folder = Path(folder)
    _check(position, rate_hz, settings)
    joints = dict(zip(JOINTS, np.moveaxis(position, 1, 0), strict=True))
    surface = pose_surface(joints, clothes=settings.clothes)
    surface = dress(surface) if dress else surface
    lowest, highest = _bounds(surface)
    if cameras is None:
        cameras = generate_cameras(center_m=(lowest + highest) / 2.0, seed=seed)
    columns, rows = _common_size(cameras)
    _start_folder(folder, (lowest, highest), rate_hz, settings, metadata)
    write_calibration(folder / "calibration.toml", cameras)
    scene = light_scene(surface)
    bits = np.zeros((len(position), len(cameras), rows, -(-columns // 8)), np.uint8)
    for number, camera in enumerate(cameras):
        shot = place_shot(
            np.column_stack([camera.rotation, camera.translation]),
            camera.intrinsics,
            camera.distortion,
            (columns, rows),
            scene,
            backdrop=settings.backdrop,
            seed=(seed, number),
        )
        empty = film_empty(shot, settings.spoilers)
        write_png(folder / "background" / f"{camera.name}.png", empty)
        images = _keep_silhouettes(
            film_scene(shot, scene, settings.spoilers, samples=settings.samples), bits[:, number]
        )
        _write_images(folder / "videos" / camera.name, images, rate_hz, settings)
    body = ~surface.is_cloth
    own = surface.triangle[body[surface.triangle[:, 0]]]
    body[body] = outer_vertices(surface.vertex[:, body], own)
    truth = CaptureTruth(position, bits, columns, surface.vertex[:, body], surface.segment[body])
    _write_truth(folder.with_name(f"{folder.name}_truth.npz"), truth, rate_hz)
    return truth


def _check(position: NDArray[np.float64], rate_hz: float, settings: FilmSettings) -> None:
    """Refuse what cannot be filmed."""
    faults = []
    if position.ndim != 3 or position.shape[1:] != (len(JOINTS), 3) or not len(position):
        faults.append(f"a track of shape {position.shape}, wanted is (time, {len(JOINTS)}, 3)")
    if not rate_hz > 0.0:
        faults.append(f"{rate_hz} frames a second, wanted are more than 0")
    if settings.samples % 2 == 0:
        faults.append(f"{settings.samples} samples along a pixel, wanted is an odd number")
    if faults:
        raise ValueError(f"this cannot be filmed: {'; '.join(faults)}")


def _common_size(cameras: Sequence[Camera]) -> tuple[int, int]:
    """Return the columns and rows that all images have, or refuse the cameras."""
    sizes = {camera.size for camera in cameras}
    if len(sizes) != 1 or None in sizes:
        raise ValueError(
            f"{len(cameras)} cameras have images of the sizes {sorted(map(str, sizes))}; "
            "give cameras that all have images of one size"
        )
    if rational := [camera.name for camera in cameras if camera.distortion[5:].any()]:
        raise ValueError(
            f"the lenses of {', '.join(rational)} bend by k4 to k6; "
            "give cameras with k1, k2, p1, p2 and k3 only"
        )
    return cameras[0].width, cameras[0].height


def _start_folder(
    folder: Path,
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
    rate_hz: float,
    settings: FilmSettings,
    metadata: Mapping[str, str] | None,
) -> None:
    """Make the folder of a capture and describe it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"the folder {folder} is not empty; name a new one for the capture")
        for name in ("videos", "background"):
            (folder / name).mkdir()
    except OSError as error:
        raise InputError(
            f"the folder {folder} cannot be made ({error.strerror}); "
            "choose a place that exists and may be written"
        ) from error
    take = {"title": "Generated performance", "performer": "generated", **(metadata or {})}
    center, size = (bounds[0] + bounds[1]) / 2.0, bounds[1] - bounds[0]
    lines = [
        "[take]",
        *(
            f"{json.dumps(name)} = {json.dumps(value, ensure_ascii=False)}"
            for name, value in take.items()
        ),
        "\n[volume]",
        f"center_m = {[round(float(value), 3) for value in center]}",
        f"size_m = {[round(float(value), 3) for value in size]}",
        f"voxel_m = {settings.voxel_m}",
        "\n[video]",
        f"fps = {float(rate_hz)}",
        'up = "y"',
    ]
    (folder / "capture.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _bounds(surface: BodySurface) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of a box from the floor around a performer, in whole 0.1 m."""
    least, most = surface.vertex.min(axis=(0, 1)), surface.vertex.max(axis=(0, 1))
    least, most = np.floor(10.0 * least - 1.0) / 10.0, np.ceil(10.0 * most + 1.0) / 10.0
    return least * [1.0, 0.0, 1.0], most


def _keep_silhouettes(
    films: Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]], bits: NDArray[np.uint8]
) -> Iterator[NDArray[np.uint8]]:
    """Yield the images of a camera, and pack the silhouettes away as they pass."""
    for frame, (image, silhouette) in enumerate(films):
        bits[frame] = np.packbits(silhouette, axis=-1)
        yield image


def _write_images(
    path: Path, images: Iterator[NDArray[np.uint8]], rate_hz: float, settings: FilmSettings
) -> None:
    """Write the images of a camera as a video, or as a folder of PNG files."""
    if settings.compressed:
        return write_video(path.with_name(f"{path.name}.mp4"), images, rate_hz)
    path.mkdir()
    for frame, image in enumerate(images):
        write_png(path / f"{frame:06d}.png", image)


def _write_truth(path: Path, truth: CaptureTruth, rate_hz: float) -> None:
    """Write what is true of a capture, in the words of the shared captures."""
    frames, cameras, rows, _ = truth.silhouette_bits.shape
    np.savez_compressed(
        path,
        joints=truth.position.astype(np.float32),
        joint_names=np.array(["head_top", *(_truth_name(joint) for joint in JOINTS[1:])]),
        verts=truth.vertex.astype(np.float16),
        vert_segment=truth.segment.astype(np.int64) - 1,
        segments=np.array([_truth_name(segment) for segment in SEGMENTS]),
        masks=truth.silhouette_bits,
        mask_shape=np.array([frames, cameras, rows, truth.columns]),
        fps=rate_hz,
    )


def _truth_name(name: str) -> str:
    """Return RForeArm as r_forearm, and so on: the words of the shared captures."""
    snake = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=^[RL])(?=[A-Z])", "_", name).lower()
    for ours, theirs in (("_fin", "_finger"), ("_foot", "_toe"), ("_fore_arm", "_forearm")):
        snake = snake.replace(ours, theirs)
    return snake
