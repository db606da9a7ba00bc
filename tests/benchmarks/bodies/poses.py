"""Measure poses and labels: `python -m tests.benchmarks.bodies.poses [FOLDER] [--only NAME ...]`.

Films the captures of `tests.benchmarks.bodies.captures` into FOLDER where they are not there yet,
digitizes them and the shared ones, and prints a table of what was found against the truth;
`--json FILE` keeps the figures. `--without 60` leaves out the first 60 frames and with them the
stretched arms, `--backwards` plays the films backwards. `--trouble` adds errors to some captures,
`--sensitivity` changes every constant of the fit by a quarter. The shared recordings are where
SHOSA_DATA says.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tasks.settings import read_settings
from tests.benchmarks.bodies.captures import PLANS, make_captures
from tests.benchmarks.bodies.runs import Voxels, describe, make_voxels, only_frames, pose, recall
from tests.benchmarks.bodies.sensitivity import measure_sensitivity
from tests.benchmarks.bodies.spoiling import troubled_voxels
from tests.benchmarks.recordings import data_folder

SHARED = ("plain", "kimono", "spin", "martial")
TROUBLED = ("shared-plain", "shared-kimono", "indian-fitting")
CHANGED = ("shared-plain", "shared-kimono", "salsa-tall-kimono")
COLUMNS = ("labels", "mean mm", "p95 mm", "> 150 mm", "run", "wrong", "flagged", "prec.", "recall")


def captures(folder: Path, only: Iterable[str]) -> dict[str, tuple[Path, Path]]:
    """Return folder and truth of the captures by name; those of our own are made."""
    data = data_folder()
    chosen = list(only) or [*(f"shared-{name}" for name in SHARED), *PLANS]
    if unknown := [name for name in chosen if name not in PLANS and name[7:] not in SHARED]:
        sys.exit(f"there is no capture {', '.join(unknown)}; choose among {', '.join(PLANS)}")
    found = {}
    for name in chosen:
        if name in PLANS:
            path = make_captures(folder / "captures", data, [name])[name]
        else:
            path = data / "captures" / name.removeprefix("shared-")
        found[name] = (path, path.with_name(f"{path.name}_truth.npz"))
    return found


def voxels_of(folder: Path, name: str, capture: Path, truth: Path) -> Voxels:
    """Return the colored voxels of a capture, made once and found again in `index.json`."""
    index = folder / "index.json"
    said = json.loads(index.read_text(encoding="utf-8")) if index.exists() else {}
    if name in said:
        return recall(said[name])
    made = make_voxels(folder / "archive", capture)
    said[name] = describe(made, truth)
    index.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return made


def row(name: str, score: dict[str, Any]) -> str:
    """Return a line of the table."""
    if "refused" in score:
        return f"| {name} | refused: {' '.join(score['refused'].split())[:150]} |"
    ms = " + ".join(f"{spent:.0f}" for spent in score["ms"].values())
    label = f"{score['labels']:.3f}" if "labels" in score else "-"
    return (
        f"| {name} | {label} | {score['mean_mm']:.1f} | {score['p95_mm']:.0f} | "
        f"{100 * score['lost']:.2f} % | {score['run']} | {score['wrong']} | {score['flagged']} | "
        f"{score['precision']:.2f} | {score['recall']:.2f} | {ms} |"
    )


def heading() -> str:
    """Return the first lines of a table."""
    names = ["capture", *COLUMNS, "ms a frame: model + pose + final + provisional + tracks"]
    return f"| {' | '.join(names)} |\n|{' --- |' * len(names)}"


def keep(scores: dict[str, Any], into: Path | None) -> None:
    """Write the figures so far."""
    if into:
        into.write_text(json.dumps(scores, indent=1), encoding="utf-8")


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def measure(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Print the table of all captures; return its figures."""
    settings = read_settings({"pose_fitting": {"method": args.method}}, "--method")
    scores = {}
    say(heading())
    for name, (capture, truth) in captures(folder, args.only).items():
        voxels, order = voxels_of(folder, name, capture, truth), None
        if args.without or args.backwards:
            order = range(args.without, len(voxels.frames))[:: -1 if args.backwards else 1]
            voxels = only_frames(voxels, order, f"{order.start}-{order.step}")
        scores[name] = pose(voxels, truth, settings, order)
        say(row(name, scores[name]))
        keep(scores, args.json)
    return scores


def measure_trouble(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Print the table of captures with added trouble; return its figures."""
    settings = read_settings({"pose_fitting": {"method": args.method}}, "--method")
    scores: dict[str, Any] = {}
    say(heading())
    for name, (capture, truth) in captures(folder, args.only or TROUBLED).items():
        place = folder / "trouble" / name
        shutil.rmtree(place, ignore_errors=True)
        for trouble, voxels in troubled_voxels(place / "archive", capture, place / "copy").items():
            scores[f"{name}, {trouble}"] = pose(voxels, truth, settings)
            say(row(f"{name}, {trouble}", scores[f"{name}, {trouble}"]))
            keep(scores, args.json)
    return scores


def measure_constants(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Print what every constant matters; return the figures."""
    chosen = captures(folder, args.only or CHANGED).items()
    voxels = {
        name: (voxels_of(folder, name, capture, truth), truth) for name, (capture, truth) in chosen
    }
    return measure_sensitivity(voxels, args.frames, say, args.json)


def main() -> None:
    """Read the command line, measure, and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", nargs="?", type=Path, help="kept; by default a temporary one")
    parser.add_argument("--method", choices=("joint", "paper"), default="joint")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--frames", type=int, default=150, help="of each, for --sensitivity")
    parser.add_argument("--without", type=int, default=0, metavar="FRAMES")
    parser.add_argument("--backwards", action="store_true")
    parser.add_argument("--trouble", action="store_true")
    parser.add_argument("--sensitivity", action="store_true")
    args = parser.parse_args()
    table = measure_trouble if args.trouble else measure
    table = measure_constants if args.sensitivity else table
    with tempfile.TemporaryDirectory() as name:
        folder = args.folder or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        keep(table(args, folder), args.json)


if __name__ == "__main__":
    main()
