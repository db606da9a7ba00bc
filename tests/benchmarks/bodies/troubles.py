"""What goes wrong on real stages, one trouble at a time.

One dance of known truth is filmed well, then with each trouble. `doctor` looks at each capture, and
it is digitized, also where ingestion would refuse it: the table tells what that would cost.

`python -m tests.benchmarks.bodies.troubles [FOLDER] [--only TROUBLE ...] [--sentences]`
"""

import argparse
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray

from flows import chain
from storage.blocks import Written, read_block
from storage.errors import InputError
from storage.formats.calibration.toml import write_calibration
from storage.formats.capture.capture import Capture, read_capture
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video import open_video, read_frames
from storage.formats.pictures.video_writing import write_video
from tasks.body.labels.provisional import ProvisionalSettings
from tasks.checks.agreement import AgreementSettings
from tasks.checks.examination import examine_capture
from tasks.checks.take_silhouettes import check_take
from tasks.reconstruction.silhouettes import SilhouetteSettings
from tests.benchmarks.bodies.props import digitize, print_table, settings_of
from tests.benchmarks.bodies.scenes import make_scene
from tests.benchmarks.bodies.scores import joint_errors, score_joints

Copy = Callable[[Path, Path], range]
"""Writes a capture with a trouble beside another one; returns which frames of that are in it."""

LATE_CAMERA = 2
"""The third camera is the one that is late."""

OPENING = 36
"""With so many frames of stretched arms, and the way from there to the dance, a scene begins."""

HEADING = (
    "| trouble | doctor | ingestion | mean mm | > 150 mm | doubtful | why |\n"
    "| --- | --- | --- | --- | --- | --- | --- |\n"
)


def films_of(source: Capture) -> Iterator[tuple[Path, NDArray[np.uint8]]]:
    """Yield where each camera's film is below the capture, and its frames."""
    for path in source.videos:
        yield path.relative_to(source.folder), read_frames(open_video(path), 0, source.frames)


def films_again(source: Capture, into: Path, part: Callable[[int], slice]) -> None:
    """Write a part of each camera's film in place of the whole."""
    for camera, (name, frames) in enumerate(films_of(source)):
        (into / name).unlink()
        write_video((into / name).with_suffix(".mp4"), iter(frames[part(camera)]), source.fps)


def late(frames: int) -> Copy:
    """Return what has one camera begin so many frames after the others."""

    def copy(capture: Path, into: Path) -> range:
        source = read_capture(capture)
        shutil.copytree(capture, into)
        left = source.frames - frames
        films_again(
            source, into, lambda c: slice(frames, None) if c == LATE_CAMERA else slice(left)
        )
        return range(left)

    return copy


def masks(change: Callable[[NDArray[np.uint8]], NDArray[Any]], settings: str = "") -> Copy:
    """Return what has masks instead of backgrounds: the true ones, changed; and its settings."""

    def copy(capture: Path, into: Path) -> range:
        source = read_capture(capture)
        truth = np.load(capture.with_name(f"{capture.name}_truth.npz"))
        shape = truth["mask_shape"]
        bits = np.unpackbits(truth["masks"], axis=-1, count=int(shape[-1]))
        shutil.copytree(capture, into)
        shutil.rmtree(into / "background")
        (into / "digitize.toml").write_text(f"[silhouettes]\n{settings}\n", encoding="utf-8")
        for c, camera in enumerate(source.cameras):
            (into / "silhouettes" / camera.name).mkdir(parents=True)
            for frame, mask in enumerate(bits[:, c]):
                white = np.repeat(255 * np.asarray(change(mask), np.uint8)[..., None], 3, axis=-1)
                write_png(into / "silhouettes" / camera.name / f"{frame:04}.png", white)
        return range(source.frames)

    return copy


def no_stage(capture: Path, into: Path) -> range:
    """Write a capture without pictures of the empty stage, and the setting that does without."""
    shutil.copytree(capture, into)
    shutil.rmtree(into / "background")
    (into / "digitize.toml").write_text('[silhouettes]\nbackground = "film"\n', encoding="utf-8")
    return range(read_capture(capture).frames)


def stood_in(capture: Path, into: Path) -> range:
    """Write a capture whose pictures of the stage show the performer, as the films begin."""
    source = read_capture(capture)
    shutil.copytree(capture, into)
    for camera, (_, frames) in zip(source.cameras, films_of(source), strict=True):
        write_png(into / "background" / f"{camera.name}.png", frames[0])
    return range(source.frames)


def no_stretched_arms(capture: Path, into: Path) -> range:
    """Write a capture that begins when the performer dances."""
    source = read_capture(capture)
    shutil.copytree(capture, into)
    films_again(source, into, lambda _: slice(OPENING, None))
    return range(OPENING, source.frames)


def half_the_cameras(capture: Path, into: Path) -> range:
    """Write a capture with every second camera."""
    source = read_capture(capture)
    shutil.copytree(capture, into)
    write_calibration(into / source.calibration.name, source.cameras[::2])
    for camera in source.cameras[1::2]:
        for folder in ("videos", "background"):
            for path in (into / folder).glob(f"{camera.name}.*"):
                path.unlink()
    return range(source.frames)


SQUARE = np.ones((3, 3), np.uint8)

TROUBLES: dict[str, str | Copy] = {
    "none": "none",
    "a camera 1 frame late": late(1),
    "a camera 3 frames late": late(3),
    "a camera 8 frames late": late(8),
    "masks": masks(lambda mask: mask),
    "masks, eroded by a pixel": masks(lambda mask: cv2.erode(mask, SQUARE)),
    "masks, eroded by a pixel, grown by one": masks(
        lambda mask: cv2.erode(mask, SQUARE), "grow_px = 1"
    ),
    "masks, dilated by a pixel": masks(lambda mask: cv2.dilate(mask, SQUARE)),
    "no empty stage": no_stage,
    "performer in the background": stood_in,
    "a dark shadow that slides": "shadow",
    "no stretched arms": no_stretched_arms,
    "half the cameras": half_the_cameras,
    "1920 x 1080": "large",
    "a chair": "chair",
    "a sword": "sword",
    "a fan": "fan",
    "an umbrella": "umbrella",
    "a second dancer apart": "second",
    "a second dancer who crosses": "crossing",
}
"""A scene of `scenes`, or what is done to the one without trouble."""


def measure(folder: Path, data: Path, trouble: str) -> tuple[str, list[str]]:
    """Return a line of the table, and the sentences that were said."""
    made = TROUBLES[trouble]
    scenes = folder / "scenes"
    scene = made if isinstance(made, str) else "none"
    capture = make_scene(scenes, data, scene)
    truth = dict(np.load(capture.with_name(f"{scene}_truth.npz")))
    if not isinstance(made, str):
        into = folder / "troubles" / trouble.replace(" ", "-").replace(",", "")
        into.parent.mkdir(exist_ok=True)
        shutil.rmtree(into, ignore_errors=True)
        truth["joints"] = truth["joints"][list(made(capture, into))]
        capture = into
    told, verdict = [], "BAD"
    settings = replace(settings_of(capture), provisional_labeling=ProvisionalSettings(keep=False))

    def asked(_: Path) -> tuple[SilhouetteSettings, AgreementSettings]:
        return settings.silhouettes, settings.agreement

    try:
        found = examine_capture(capture, folder / "doctor" / capture.name, asked)
        verdict = f"{len(found.faults)} BAD" if found.faults else "ok"
        verdict += f", {len(found.notes)} notes" if found.notes else ""
        told = [*(f"BAD {fault}" for fault in found.faults), *(f"note: {n}" for n in found.notes)]
    except InputError as error:
        told = [f"BAD {error}"]
    refused: list[str] = []

    def check(**given: Any) -> list[str]:
        try:
            return check_take(**given)
        except InputError as error:
            refused.append(str(error))
            return []

    with patch.object(chain, "check_take", check):
        voxels, blocks, notes = digitize(capture, folder / "archives" / capture.name, settings)
    told += [f"ingestion: {each}" for each in (*refused, *notes)]
    own = "refuses" if refused else "takes"
    if "joint_tracks" not in blocks:
        return f"| {trouble} | {verdict} | {own} | no pose | | | |", told

    def read(stage: str) -> dict[str, Any]:
        return read_block(voxels.place, one(blocks[stage]).block)

    fit = read("pose_fitting")
    score = score_joints(joint_errors(read("joint_tracks")["position"], truth), fit["doubtful"])
    share = score["flagged"] / len(fit["doubtful"])
    return (
        f"| {trouble} | {verdict} | {own} | {score['mean_mm']:.1f} | {score['lost']:.2%} | "
        f"{share:.0%} | {why(fit)} |"
    ), told


def one(written: list[Written]) -> Written:
    """Return the only block of a stage."""
    [only] = written
    return only


def why(fit: dict[str, Any]) -> str:
    """Return for which reasons frames are doubtful, each with its number of frames."""
    doubtful = np.asarray(fit["doubtful"])
    named = ("unmeasured", "unexplained", "cut_off", "hidden")
    counts = {name: int((fit[name] & doubtful).sum()) for name in named if name in fit}
    known = np.any([fit[name] for name in counts], axis=0)
    counts["limbs"] = int((doubtful & ~known).sum())
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def main() -> None:
    """Read the command line, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", nargs="?", type=Path, help="kept; by default a temporary one")
    parser.add_argument("--only", nargs="+", choices=TROUBLES, default=tuple(TROUBLES))
    parser.add_argument("--sentences", action="store_true", help="what was said of each, too")
    args = parser.parse_args()
    print_table(HEADING, args.folder, args.only, measure, said=args.sentences)


if __name__ == "__main__":
    main()
