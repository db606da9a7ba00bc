"""Read a capture: calibration, videos, backgrounds or masks (docs/contract.md, section 3).

Before anything is computed, all of it is checked against each other: every camera has a video and
a background or masks, image sizes agree, frame counts agree, and the cameras look at the volume.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from storage.errors import InputError
from storage.formats.calibration.camera import Camera
from storage.formats.calibration.parts import Calibration
from storage.formats.calibration.reading import load_calibration, place_cameras
from storage.formats.capture.capture_files import (
    FOLDERS,
    NOTHING_TELLS,
    files_of,
    find_calibration,
    find_telling,
    unknown_folders,
    unread_files,
)
from storage.formats.capture.capture_toml import MARK, CaptureSettings, Volume, read_capture_toml
from storage.formats.capture.clocks import clock_notes
from storage.formats.capture.footage import (
    Footage,
    by_px,
    footage_notes,
    look_at_footage,
    mask_faults,
    why_other_background,
    why_unequal,
)
from storage.formats.capture.initial import read_initial
from storage.formats.capture.offsets import Alignment, align_films, read_offsets
from storage.formats.reading import listed

RATE_TOLERANCE = 0.01
"""Relative difference of frame rates that is taken for rounding (30 and 29.97)."""


@dataclass(frozen=True, eq=False)
class Capture:
    """A capture that passed every check; the tuples are in the order of the cameras."""

    folder: Path
    take: str
    """The name that its take is to have."""
    metadata: dict[str, Any]
    """The table [take], without id and stature_m."""
    stature_m: float | None
    volume: Volume
    fps: float
    cameras: tuple[Camera, ...]
    """Metres, y up, every image size known."""
    videos: tuple[Path, ...]
    """A video file, or a folder of images."""
    backgrounds: tuple[Path, ...]
    """A picture, or a video; none where there is no such folder, or where there are masks."""
    frames: int
    """Moments that all videos show, as their headers say."""
    calibration: Path
    initial: Path | None
    """`initial.json`, where there is one."""
    seen_share: tuple[float, ...]
    """Share of the volume, 0 to 1, that each camera films."""
    notes: tuple[str, ...] = ()
    """What had to be assumed, a sentence each."""
    first_frames: tuple[int, ...] = ()
    """The frame of each video that is frame 0 of the take."""
    offsets_s: tuple[float, ...] = ()
    """How much later than the others each video began, as capture.toml says."""
    unequal: str = ""
    """What is wrong with the lengths of the videos, where they may differ."""
    masks: tuple[Path, ...] = ()
    """A video of masks, or a folder of pictures of them; none where there is no such folder."""


def read_capture(folder: Path, *, any_length: bool = False) -> Capture:
    """Read and check a capture.

    Parameters
    ----------
    folder : Path
        With capture.toml, a calibration, `videos`, and `background` or `silhouettes`.
    any_length
        Let videos of unequal length pass, to find out when each began; `unequal` tells of them.

    Raises
    ------
    InputError
        With everything that is wrong, a line each.
    """
    folder = Path(folder)
    faults: list[str] = []
    notes: list[str] = []
    said = read_capture_toml(folder, faults, notes)
    volume = said.volume
    notes += unknown_folders(folder)
    path = find_calibration(folder, faults, notes)
    films = files_of("video", folder, faults)
    told_by = find_telling(folder, notes)
    others = files_of(told_by, folder, faults)
    found = _load_cameras(path, films or {}, faults)
    videos = _match("video", folder, films, found.cameras, faults, notes)
    telling = _match(told_by, folder, others, found.cameras, faults, notes)
    notes += footage_notes({"video": videos, told_by: telling})
    sized = [_sized(camera, videos, faults, notes) for camera in found.cameras]
    backgrounds = {} if told_by == "mask" else telling
    masks = telling if told_by == "mask" else {}
    faults += _size_faults(sized, videos, backgrounds)
    for name in masks:
        faults += mask_faults(name, videos.get(name), masks[name])
    cameras, unit_m = _place(path, replace(found, cameras=sized), said, faults, notes)
    fps = _rate(said.fps, videos, faults, notes)
    offsets_s = read_offsets(said.video, [each.name for each in found.cameras], MARK, faults)
    aligned = _align(videos, offsets_s, fps, faults, notes, any_length=any_length)
    notes += clock_notes(videos, fps or 0.0)
    frames = aligned.frames
    assumed = found.unit_m is None and said.unit_m is None
    shares = _views(cameras, volume, unit_m, faults, notes, assumed=assumed)
    initial = folder / "initial.json"
    has_initial = os.path.lexists(initial)
    faults += _initial_faults(initial, frames) if has_initial else []
    if faults or volume is None or path is None or fps is None:
        faults += [NOTHING_TELLS] if others is None else []
        raise InputError("\n".join([f"{folder} cannot be used as a capture:", *_dashed(faults)]))
    return Capture(
        folder, said.take, said.metadata, said.stature_m, volume, fps, tuple(cameras),
        tuple(videos[camera.name].path for camera in cameras),
        tuple(backgrounds[camera.name].path for camera in cameras if backgrounds),
        frames, path, initial if has_initial else None, tuple(shares), tuple(notes),
        aligned.first_frames,
        tuple((offsets_s or {}).get(camera.name, 0.0) for camera in cameras), aligned.unequal,
        tuple(masks[camera.name].path for camera in cameras if masks),
    )  # fmt: skip


@lru_cache(maxsize=8)  # takes that one process digitizes side by side
def capture_of(folder: str, digest: str) -> Capture:  # noqa: ARG001 - what is kept is of it
    """Read a capture whose content has this digest; once a process, whatever stage asks.

    Parameters
    ----------
    folder
        The capture.
    digest
        As of `storage.recordings.digest_capture`.

    Raises
    ------
    InputError
        As `read_capture`.
    """
    return read_capture(Path(folder))


def _initial_faults(path: Path, frames: int) -> list[str]:
    """Return what is wrong with an `initial.json` by itself."""
    try:
        frame = read_initial(path).frame or 0
    except InputError as error:
        return [str(error)]
    if frames and frame >= frames:
        return [
            f"{path} is of frame {frame}; the take has the frames 0-{frames - 1}, give one of them"
        ]
    return []


def _dashed(faults: Sequence[str]) -> list[str]:
    return [f"- {' '.join(fault.split())}" for fault in faults]


def _load_cameras(
    path: Path | None, films: dict[str, list[Path]], faults: list[str]
) -> Calibration:
    """Return the cameras in their own unit and axes; none where they cannot be read."""
    try:
        return load_calibration(path, films.keys()) if path else Calibration([])
    except InputError as error:
        faults.append(str(error))
        return Calibration([])


def _place(
    path: Path | None,
    found: Calibration,
    said: CaptureSettings,
    faults: list[str],
    notes: list[str],
) -> tuple[list[Camera], float]:
    """Return the cameras in metres and y up, and the unit that they were read in."""
    if path is None or not found.cameras:
        return [], 1.0
    known: dict[str, Any] = {}
    if said.volume is not None:
        known = {"center_m": said.volume.center_m, "distance_m": said.volume.diagonal_m}
        if all(camera.size is not None for camera in found.cameras):
            known["count_seeing"] = partial(_count_seeing, volume=said.volume)
    try:
        cameras, unit_m, more = place_cameras(path, found, up=said.up, unit_m=said.unit_m, **known)
    except InputError as error:
        faults.append(str(error))
        return [], 1.0
    notes += more
    return cameras, unit_m


def _count_seeing(cameras: Sequence[Camera], volume: Volume) -> int:
    # it imports OpenCV, which who lists captures need not pay for
    from storage.formats.capture.camera_views import count_seeing

    return count_seeing(cameras, volume)


def _match(
    what: str,
    folder: Path,
    files: dict[str, list[Path]] | None,
    cameras: Sequence[Camera],
    faults: list[str],
    notes: list[str],
) -> dict[str, Footage]:
    """Return the file of each camera, by name, and say which are missing, double or unreadable."""
    if files is None:
        return {}
    names = [camera.name for camera in cameras]
    missing = [name for name in names if name not in files]
    others = sorted(files.keys() - set(names))
    if missing:
        rest = f"; {listed(others)} belongs to no camera of the calibration" if others else ""
        rest += unread_files(what, folder, missing)
        faults.append(
            f"camera {listed(missing)} has no {what} in `{FOLDERS[what]}`{rest}: name each file as "
            "its camera is called in the calibration"
        )
    elif others and cameras:
        notes.append(f"The {what} of {listed(others)} has no calibration: left out.")
    return _look(what, files, names, faults)


def _look(
    what: str, files: dict[str, list[Path]], names: Sequence[str], faults: list[str]
) -> dict[str, Footage]:
    """Look into the file of each camera that has one."""
    found = {}
    for name in names:
        paths = files.get(name, [])
        if len(paths) > 1:
            faults.append(
                f"camera {name!r} has more than one {what}: "
                f"{listed([path.name for path in paths])}; keep one"
            )
        elif paths:
            try:
                found[name] = look_at_footage(paths[0], masks=what == "mask")
            except InputError as error:
                faults.append(f"camera {name!r}: {error}")
            except OSError as error:
                faults.append(f"camera {name!r}: {paths[0]} cannot be read ({error.strerror})")
    return found


def _sized(
    camera: Camera, videos: dict[str, Footage], faults: list[str], notes: list[str]
) -> Camera:
    """Return the camera with an image size: the video's, where the calibration does not say."""
    if camera.size is not None or camera.name not in videos:
        return camera
    size = videos[camera.name].size
    note = "The calibration does not say image sizes: those of the videos were taken."
    if note not in notes:
        notes.append(note)
    column, row = camera.intrinsics[:2, 2]
    if not (0 < column < size[0] and 0 < row < size[1]):
        faults.append(
            f"camera {camera.name!r}: its video is {by_px(size)}, but the calibration has the "
            f"middle of the image at {column:.0f}, {row:.0f}: it was made for another image size, "
            "or the video is turned"
        )
    return replace(camera, size=size)


def _size_faults(
    cameras: Sequence[Camera], videos: dict[str, Footage], backgrounds: dict[str, Footage]
) -> list[str]:
    """Return which image sizes disagree."""
    faults = []
    for camera in cameras:
        video, background = videos.get(camera.name), backgrounds.get(camera.name)
        if video and camera.size and video.size != camera.size:
            why = why_unequal(video, camera.size)
            faults.append(
                f"camera {camera.name!r}: its video is {by_px(video.size)}, its calibration was "
                f"made for {by_px(camera.size)}: {why}"
            )
        agreed = background is None or background.size in (video and video.size, camera.size)
        if video and background and not agreed:
            faults.append(
                f"camera {camera.name!r}: its background is {by_px(background.size)}, its video "
                f"{by_px(video.size)}; {why_other_background(video, background)}"
            )
    return faults


def _rate(
    fps: float | None, videos: dict[str, Footage], faults: list[str], notes: list[str]
) -> float | None:
    """Return the frame rate, and say where the videos disagree."""
    rates = {name: video.rate_hz for name, video in videos.items() if video.rate_hz}
    if rates:
        usual = float(np.median(list(rates.values())))
        odd = {name: rate for name, rate in rates.items() if not _close(rate, usual)}
        if odd:
            said = ", ".join(f"{name!r} at {rate:g}" for name, rate in odd.items())
            faults.append(
                f"the videos were not filmed at one rate: {said}, the others at {usual:g} frames "
                "a second; convert them to one"
            )
        elif fps is None:
            notes.append(f"{MARK} has no fps: the videos' {usual:g} was taken.")
            return usual
        elif not _close(fps, usual):
            notes.append(
                f"The videos say {usual:g} frames a second and {MARK} {fps:g}, which was taken."
            )
    if fps is None and not rates:
        faults.append(f"{MARK} has no fps under [video], and the videos do not say it; write it")
    return fps


def _close(rate: float, other: float) -> bool:
    return abs(rate - other) <= RATE_TOLERANCE * other


def _align(
    videos: dict[str, Footage],
    offsets_s: dict[str, float] | None,
    fps: float | None,
    faults: list[str],
    notes: list[str],
    *,
    any_length: bool,
) -> Alignment:
    """Return which frames of the videos are those of the take."""
    counts = {name: video.frames for name, video in videos.items()}
    aligned = align_films(counts, offsets_s, fps or 0.0, faults, notes)
    if aligned.unequal and not any_length:
        faults.append(aligned.unequal)
    return aligned


def _views(
    cameras: Sequence[Camera],
    volume: Volume | None,
    unit_m: float,
    faults: list[str],
    notes: list[str],
    *,
    assumed: bool,
) -> list[float]:
    """Return the share of the volume that each camera sees, and say it."""
    # it imports OpenCV, which who lists captures need not pay for
    from storage.formats.capture.camera_views import view_faults

    if volume is None or not cameras or any(camera.size is None for camera in cameras):
        return []
    shares, found = view_faults(cameras, volume, unit_m, assumed=assumed)
    faults += found
    said = ", ".join(
        f"{camera.name} {share:.0%}" for camera, share in zip(cameras, shares, strict=True)
    )
    notes.append(f"The cameras see this much of the volume: {said}.")
    return shares
