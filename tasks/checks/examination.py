"""Examine a capture before it is digitized: files, silhouettes, and a picture per camera."""

import unicodedata
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.capture.capture import Capture, read_capture
from tasks.capture.films import grid_of, projection_of
from tasks.capture.tangency import Outline
from tasks.checks.agreement import Agreement, AgreementSettings, check_agreement
from tasks.checks.bodies import held_notes
from tasks.checks.compared import Compared, prepare_seeing, see_silhouettes
from tasks.checks.offsets import Beginnings, judge_beginnings, timing_of
from tasks.checks.pictures import draw_capture_checks, draw_silhouette
from tasks.checks.refinement import Refinement, refine_capture
from tasks.checks.telling import all_faults, filled_notes, judge_telling
from tasks.checks.watching import watch_films
from tasks.engine.progress import within
from tasks.reconstruction.silhouettes import SilhouetteSettings

_WATCHED, _WATCHED_AGAIN = 0.75, 0.85
"""How much of the work is done when films were looked through, and again from where they begin
[share]. Of 8 cameras, 150 frames; only for who waits."""
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
    begun: Beginnings
    notes: tuple[str, ...]
    pictures: tuple[Path, ...]
    refined: Refinement | None = None
    """Where the silhouettes have the cameras, if it was asked for."""
    unwritten: str = ""
    """Why there are no pictures, where they could not be written."""

    @property
    def faults(self) -> tuple[str, ...]:
        """What must be corrected before the capture is digitized, a sentence each."""
        return (*self.begun.faults, *self.agreement.faults)


def examine_captures(
    folders: Sequence[str],
    into: Path | None,
    report: Callable[[str], None],
    say: Callable[[str], None],
    settings_of: SettingsOf = _usual_settings,
    watch: Callable[[str], AbstractContextManager[None]] = nullcontext,
    *,
    refine: bool = False,
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
    watch
        Gives what is entered while a capture, by its name, is examined: it may listen how far that
        is.
    refine
        As for `examine_capture`.
    """
    good = True
    names = _names_apart([Path(folder).resolve() for folder in folders])
    for folder, name in zip(map(Path, folders), names, strict=True):
        own = Path(f"{name}-doctor")
        if into:
            own = into / name if len(folders) > 1 else into
        try:
            with watch(name):
                found = examine_capture(folder, own, settings_of, refine=refine)
        except InputError as error:
            say(f"shosa: {error}")
            good = False
            continue
        for line in report_lines(found):
            report(line)
        good = good and not found.faults
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
    *,
    refine: bool = False,
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
    refine
        Whether cameras are moved to where the silhouettes have them, beside the pictures.

    Raises
    ------
    InputError
        With all that is wrong with the files, a line each; or a film, named by its camera,
        cannot be decoded to its end, or nothing tells the performer from the stage.
    """
    capture = read_capture(folder, any_length=True)
    silhouettes, settings = settings_of(folder)
    into = into or Path(f"{folder.resolve().name}-doctor")
    if into.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{into} is within the capture, which is left as it is; choose another")
    seeing = prepare_seeing(capture, silhouettes)
    projection, timing = projection_of(capture.cameras), timing_of(capture, settings.late_frames)
    with within(0.0, _WATCHED):
        watched = watch_films(capture, seeing, timing.step)
    begun = judge_beginnings(watched.passages, projection, timing, unequal=capture.unequal)
    together, notes, outlines = capture, begun.notes, watched.outlines
    if begun.line:
        together = _together(capture, begun)
        with within(_WATCHED, _WATCHED_AGAIN):
            watched = watch_films(together, seeing, timing.step, passages=False)
        notes = (*notes, "The silhouettes were compared as that line would have the films.")
    seen = see_silhouettes(together, watched.frames, watched.numbers, seeing)
    wrong, known = judge_telling(seen.telling, capture, seen.silhouettes)
    names = list(timing.names)
    found = check_agreement(
        seen.silhouettes, projection, grid_of(capture), names, settings, seeing.by
    )
    notes = (*notes, *known, *found.notes, *_gain_notes(names, seen.gains))
    pixels, kept = seen.silhouettes.sum(axis=(2, 3)), silhouettes.holes == "keep"
    notes = (*notes, *filled_notes(seen.filled, pixels, names, kept=kept))
    found = replace(found, faults=all_faults(seen.telling, wrong, found.faults))
    if not found.faults:
        notes = (*notes, *held_notes(seen.silhouettes, projection, grid_of(capture)))
    pictures, refined, unwritten = (), None, ""
    try:
        pictures = _draw(capture, watched.frames, seen, into)
        if refine:
            refined = _refine(capture, outlines, begun, into)
    except OSError as error:
        unwritten = (
            f"the pictures cannot be written into {into} ({error.strerror or error}); name a "
            "folder that can be written by --out"
        )
    return Examination(capture, found, begun, notes, pictures, refined, unwritten)


def _refine(
    capture: Capture, outlines: Sequence[Outline], begun: Beginnings, into: Path
) -> Refinement:
    """Move the cameras, unless films began at different moments: then their places tell nothing."""
    if begun.faults:
        return Refinement(("the cameras are not refined before the films begin together",))
    return refine_capture(capture, outlines, into)


def report_lines(found: Examination) -> list[str]:
    """Return what was found as lines of text: a table of the cameras, notes, faults or "ok"."""
    capture, agreement = found.capture, found.agreement
    lines = [
        f"{capture.folder}: {len(capture.cameras)} cameras, {capture.frames} frames at "
        f"{capture.fps:g} Hz",
        f"{'camera':16} {'image':>10} {'sees':>6} {'silhouette':>11} {'explained':>10} "
        f"{'overlap':>8} {'late':>7}",
    ]
    for n, camera in enumerate(capture.cameras):
        lines.append(
            f"{camera.name:16} {f'{camera.width}x{camera.height}':>10} "
            f"{capture.seen_share[n]:6.0%} {agreement.silhouette[n]:11.1%} "
            f"{_share(agreement.explained[n]):>10} {_share(agreement.overlap[n]):>8} "
            f"{_late(found.begun, n):>7}"
        )
    lines += [f"note: {note}" for note in (*capture.notes, *found.notes)]
    lines += [f"BAD {fault}" for fault in found.faults]
    if found.refined:
        lines += found.refined.lines
    if found.pictures:
        lines.append(f"pictures: {found.pictures[0].parent}")
    else:
        lines.append("pictures: none, they could not be written")
    if not found.faults:
        lines.append("ok")
    return lines


def _late(begun: Beginnings, camera: int) -> str:
    """Return how many frames late a film is, as far as that is known."""
    if begun.loses[camera]:
        return "loses"
    late = begun.late_frames[camera]
    return "?" if np.isnan(late) else f"{round(late, 1) + 0.0:+.1f}"


def _share(share: float) -> str:
    return "-" if np.isnan(share) else f"{share:.0%}"


def _together(capture: Capture, begun: Beginnings) -> Capture:
    """Return a capture whose films begin where they were found to."""
    late = np.nan_to_num(begun.late_frames).round().astype(int)
    moved = (late.max() - late).tolist()
    first = [a + b for a, b in zip(capture.first_frames, moved, strict=True)]
    return replace(capture, first_frames=tuple(first), frames=capture.frames - max(moved))


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
