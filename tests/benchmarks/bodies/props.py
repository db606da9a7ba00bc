"""Measure what is not the dancer.

    python -m tests.benchmarks.bodies.props [FOLDER] [--only NAME ...]

Films the scenes of `tests.benchmarks.bodies.scenes` into FOLDER where they are not there yet,
digitizes them, and prints a table: how much of the things has the label 0, how much of the dancer
has it wrongly, and joints and labels against the truth. `--notes` prints what was noted, too.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from flows import chain
from storage import create_archive
from storage.blocks import Written, read_block
from storage.formats.capture.capture import read_capture
from storage.formats.settings_toml import SETTINGS_FILE, read_capture_settings
from storage.recordings import Recording, digest_capture
from tasks.settings import Settings, read_settings
from tests.benchmarks.bodies.runs import Voxels, labelled
from tests.benchmarks.bodies.scenes import SCENES, make_scene
from tests.benchmarks.bodies.scores import joint_errors, label_accuracy, score_joints
from tests.benchmarks.recordings import data_folder

Measure = Callable[[Path, Path, str], tuple[str, list[str]]]
"""Returns a line of a table, and sentences, given a folder, the recordings and a name."""

EVERY = 7
"""Voxels are scored in every so many frames."""
AT_M, AWAY_M, BODY_M, BESIDE_M = 0.02, 0.05, 0.03, 0.06
"""A voxel is a thing's that is so near to its surface and so far from the dancer's; and a voxel is
the dancer's that is so near to his and so far from the thing's."""
HEADING = (
    "| scene | things with label 0 | dancer with label 0 | mean mm | > 150 mm | labels | "
    "flagged |\n| --- | --- | --- | --- | --- | --- | --- |\n"
)


def digitize(
    capture: Path, archive: Path, settings: Settings
) -> tuple[Voxels, dict[str, list[Written]], list[str]]:
    """Digitize a capture into a new archive; return its voxels, all blocks, and the notes."""
    shutil.rmtree(archive, ignore_errors=True)
    create_archive(str(archive))
    source = read_capture(capture)
    recording = Recording(
        str(capture), digest_capture(capture), source.take, source.metadata, kind="capture"
    )
    blocks, notes = chain.digitize(
        str(archive), recording, settings,
        run=lambda function, **given: function(**given),
        tell=lambda _stage, _end: None,
    )  # fmt: skip
    more = [note for written in blocks.values() for each in written for note in each.notes]
    return Voxels(str(archive), recording, blocks), blocks, [*notes, *more]


def settings_of(capture: Path) -> Settings:
    """Return the settings that a capture's `digitize.toml` asks for."""
    return read_settings(read_capture_settings(capture), f"{capture}/{SETTINGS_FILE}")


def measure(folder: Path, data: Path, name: str) -> tuple[str, list[str]]:
    """Return a line of the table for a scene, and what was noted."""
    capture = make_scene(folder / "scenes", data, name)
    voxels, blocks, notes = digitize(capture, folder / "archives" / name, settings_of(capture))
    if "joint_tracks" not in blocks:
        return f"| {name} | no pose |", notes

    def read(stage: str, array: str) -> Any:
        parts = [read_block(voxels.place, each.block, [array])[array] for each in blocks[stage]]
        return np.concatenate(parts)

    truth = dict(np.load(capture.with_name(f"{name}_truth.npz")))
    label = read("final_labeling", "label")
    position, doubtful = read("joint_tracks", "position"), read("pose_fitting", "doubtful")
    joints = score_joints(joint_errors(position, truth), doubtful)
    some = list(labelled(voxels, label, EVERY))
    things, dancer = _unlabelled(some, np.load(capture.with_name(f"{name}_things.npz")))
    return (
        f"| {name} | {things:.1%} | {dancer:.3%} | {joints['mean_mm']:.1f} | "
        f"{joints['lost']:.2%} | {label_accuracy(some, truth):.3f} | {joints['flagged']} |"
    ), notes


def _unlabelled(frames: Sequence[Any], surfaces: Any) -> tuple[float, float]:
    """Return the share of the things' voxels that have label 0, and of the dancer's."""
    counts = np.zeros((2, 2), np.int64)
    for center, label, frame in frames:
        away = [
            KDTree(surfaces[name][frame].astype(float)).query(center)[0]
            if surfaces[name].shape[1]
            else np.full(len(center), np.inf)
            for name in ("things", "body")
        ]
        for n, own in enumerate(
            ((away[0] < AT_M) & (away[1] > AWAY_M), (away[1] < BODY_M) & (away[0] > BESIDE_M))
        ):
            counts[n] += int((label[own] == 0).sum()), int(own.sum())
    things, dancer = counts[:, 0] / np.maximum(counts[:, 1], 1)
    return float(things), float(dancer)


def print_table(
    heading: str, kept: Path | None, names: Sequence[str], measure: Measure, *, said: bool
) -> None:
    """Print a line for each name as soon as it is measured; below it what was said, if asked for.

    What is made for it goes into the folder `kept`, or a temporary one.
    """
    sys.stdout.write(heading)
    with tempfile.TemporaryDirectory() as temporary:
        folder = kept or Path(temporary)
        for part in ("scenes", "archives"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        for name in names:
            line, sentences = measure(folder, data_folder(), name)
            below = "".join(f"    {each}\n" for each in sentences) if said else ""
            sys.stdout.write(f"{line}\n{below}")
            sys.stdout.flush()


def main() -> None:
    """Read the command line, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", nargs="?", type=Path, help="kept; by default a temporary one")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=tuple(SCENES))
    parser.add_argument("--notes", action="store_true")
    args = parser.parse_args()
    print_table(HEADING, args.folder, args.only, measure, said=args.notes)


if __name__ == "__main__":
    main()
