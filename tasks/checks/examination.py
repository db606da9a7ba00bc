"""Examine a capture before it is digitized: files, silhouettes, and a picture per camera."""

import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.capture.capture import Capture, read_capture
from storage.formats.pictures.video import Video, open_video, read_blocks
from tasks.capture.films import grid_of, of_camera, projection_of
from tasks.checks.agreement import Agreement, AgreementSettings, check_agreement
from tasks.checks.compared import Compared, see_silhouettes
from tasks.checks.pictures import draw_capture_checks, draw_silhouette
from tasks.checks.telling import all_faults, judge_telling
from tasks.reconstruction.silhouettes import SilhouetteSettings

_LOOKED_AT = 8
"""Frames of a take."""
_WITHIN_S = 60.0
"""From the beginning: a film with one key frame is decoded from there to each frame."""
_BLOCK = 16
"""Frames that are decoded at a time. Few, so that films of any size fit into memory."""
_DARKEST, _BRIGHTEST = 0.7, 1.4
"""Times as bright as its background a film may be before it is said."""

SettingsOf = Callable[[Path], tuple[SilhouetteSettings, AgreementSettings]]
"""Reads the settings of a capture."""


def _usual_settings(_: Path) -> tuple[SilhouetteSettings, AgreementSettings]:
    return SilhouetteSettings(), AgreementSettings()


@dataclass(frozen=True, eq=False)
class Examination:
    """What was found of a capture that can be read."""

    capture: Capture
    agreement: Agreement
    notes: tuple[str, ...]
    pictures: tuple[Path, ...]
    unwritten: str = ""
    """Why there are no pictures, where they could not be written."""


def examine_captures(
    folders: Sequence[str],
    into: Path | None,
    report: Callable[[str], None],
    say: Callable[[str], None],
    settings_of: SettingsOf = _usual_settings,
) -> bool:
    """Examine captures one after another, and return whether all are good.

    Parameters
    ----------
    folders
        The captures.
    into
        As for `examine_capture`; of several captures each has a folder of its own there.
    report, say
        Called with each line of a report, and with what is wrong with files.
    settings_of
        How silhouettes are found in a capture, and what is agreement.
    """
    good = True
    names = _names_apart([Path(folder).resolve() for folder in folders])
    for folder, name in zip(map(Path, folders), names, strict=True):
        own = Path(f"{name}-doctor")
        if into:
            own = into / name if len(folders) > 1 else into
        try:
            found = examine_capture(folder, own, settings_of)
        except InputError as error:
            say(f"shosa: {error}")
            good = False
            continue
        for line in report_lines(found):
            report(line)
        good = good and not found.agreement.faults
        if found.unwritten:
            say(f"shosa: {found.unwritten}")
            good = good and into is None  # nobody asked for the usual place
    return good


def _names_apart(folders: Sequence[Path]) -> list[str]:
    """Return a name a folder, no two alike, even where capitals are not told apart."""
    names: list[str] = []
    taken: set[str] = set()
    for folder in folders:
        wished = (folder.name, f"{folder.parent.name}-{folder.name}".strip("-"))
        numbered = (f"{folder.name}-{number}" for number in range(2, len(folders) + 2))
        name = next(each for each in (*wished, *numbered) if _alike(each) not in taken)
        taken.add(_alike(name))
        names.append(name)
    return names


def _alike(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def examine_capture(
    folder: Path,
    into: Path | None = None,
    settings_of: SettingsOf = _usual_settings,
) -> Examination:
    """Examine a capture, and draw what its cameras see.

    Parameters
    ----------
    folder
        The capture.
    into
        The folder for the pictures: the volume and the floor over each background, and the
        silhouette over a frame of each film. By default `<name of the capture>-doctor` in the
        working directory.
    settings_of
        How silhouettes are found in a capture, and what is agreement.

    Raises
    ------
    InputError
        With all that is wrong with the files, a line each; or a film, named by its camera,
        cannot be decoded to its end, or nothing tells the performer from the stage.
    """
    capture = read_capture(folder)
    silhouettes, agreement = settings_of(folder)
    into = into or Path(f"{folder.resolve().name}-doctor")
    if into.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{into} is within the capture, which is left as it is; choose another")
    frames, numbers = _sampled_frames(capture)
    seen = see_silhouettes(capture, frames, numbers, silhouettes)
    names = [camera.name for camera in capture.cameras]
    faults, notes = judge_telling(seen.telling, capture, seen.silhouettes)
    found = check_agreement(
        seen.silhouettes, projection_of(capture.cameras), grid_of(capture), names, agreement,
        seen.telling.by,
    )  # fmt: skip
    notes += [*found.notes, *_gain_notes(names, seen.gains)]
    found = replace(found, faults=all_faults(seen.telling, faults, found.faults))
    pictures, unwritten = (), ""
    try:
        pictures = _draw(capture, frames, seen, into)
    except OSError as error:
        unwritten = (
            f"the pictures cannot be written into {into} ({error.strerror or error}); name a "
            "folder that can be written by --out"
        )
    return Examination(capture, found, tuple(notes), pictures, unwritten)


def report_lines(found: Examination) -> list[str]:
    """Return what was found as lines of text: a table of the cameras, notes, faults or "ok"."""
    capture, agreement = found.capture, found.agreement
    lines = [
        f"{capture.folder}: {len(capture.cameras)} cameras, {capture.frames} frames at "
        f"{capture.fps:g} Hz",
        f"{'camera':16} {'image':>10} {'sees':>6} {'silhouette':>11} {'explained':>10} "
        f"{'overlap':>8}",
    ]
    for n, camera in enumerate(capture.cameras):
        lines.append(
            f"{camera.name:16} {f'{camera.width}x{camera.height}':>10} "
            f"{capture.seen_share[n]:6.0%} {agreement.silhouette[n]:11.1%} "
            f"{_share(agreement.explained[n]):>10} {_share(agreement.overlap[n]):>8}"
        )
    lines += [f"note: {note}" for note in (*capture.notes, *found.notes)]
    lines += [f"BAD {fault}" for fault in agreement.faults]
    if found.pictures:
        lines.append(f"pictures: {found.pictures[0].parent}")
    else:
        lines.append("pictures: none, they could not be written")
    if not agreement.faults:
        lines.append("ok")
    return lines


def _share(share: float) -> str:
    return "-" if np.isnan(share) else f"{share:.0%}"


def _sampled_frames(capture: Capture) -> tuple[list[NDArray[np.uint8]], list[int]]:
    """Return a few frames (time, row, column, 3) of each camera, and which, each film read once."""
    videos = [
        of_camera(camera, lambda path=path: open_video(path))
        for camera, path in zip(capture.cameras, capture.videos, strict=True)
    ]
    end = min(capture.frames, max(int(_WITHIN_S * capture.fps), 1))
    chosen = set(np.linspace(0, end - 1, _LOOKED_AT).round().astype(int).tolist())
    frames = [
        of_camera(camera, lambda video=video: _chosen(video, chosen, end))
        for camera, video in zip(capture.cameras, videos, strict=True)
    ]
    return frames, sorted(chosen)


def _chosen(video: Video, chosen: set[int], end: int) -> NDArray[np.uint8]:
    """Return some frames of a film, read through from its beginning."""
    found = []
    for start, (frames,) in read_blocks([video], block=_BLOCK, end=end):
        found += [frame.copy() for n, frame in enumerate(frames, start) if n in chosen]
    return np.stack(found)


def _gain_notes(names: Sequence[str], gains: Sequence[float]) -> tuple[str, ...]:
    """Say which films are much brighter or darker than their backgrounds."""
    return tuple(
        f"The film of camera {name!r} is {gain:.2f} times as bright as its background: film both "
        "with the same exposure."
        for name, gain in zip(names, gains, strict=True)
        if not _DARKEST <= gain <= _BRIGHTEST
    )


def _draw(
    capture: Capture,
    frames: Sequence[NDArray[np.uint8]],
    seen: Compared,
    into: Path,
) -> tuple[Path, ...]:
    """Write two pictures a camera side by side, and return where."""
    into.mkdir(parents=True, exist_ok=True)
    middle = len(seen.silhouettes) // 2
    how = "given" if seen.telling.by == "mask" else "found"
    written = []
    for n, (name, check) in enumerate(draw_capture_checks(capture, behind=seen.behind).items()):
        frame = frames[n][middle]
        silhouette = np.ascontiguousarray(
            seen.silhouettes[middle, n, : frame.shape[0], : frame.shape[1]]
        )
        beside = draw_silhouette(frame, silhouette, title=f"{name}: the silhouette {how}")
        path = into / f"{name}.png"
        _write_picture(path, np.concatenate([check, beside], axis=1))
        written.append(path)
    return tuple(written)


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    path.write_bytes(data.tobytes())
