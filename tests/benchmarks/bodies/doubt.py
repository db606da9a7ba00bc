"""Measure doubt: `python -m tests.benchmarks.bodies.doubt FOLDER [--learn] [--json FILE]`.

Films the captures of `doubt_captures` into FOLDER where they are not there yet,
digitizes them and the shared ones, and prints how many wrong frames are doubtful, how many doubtful
frames are wrong, and how often a segment is wrong that is so doubtful (reliability). `--learn` fits
the weights on the captures for tuning first, writes them into `tasks.body.doubt.weights`, and
prints of those captures what weights say that were learned without their dances. The shared
recordings are where SHOSA_DATA says.
"""

import argparse
import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from flows import chain
from storage.blocks import read_block
from storage.errors import InputError
from storage.schema import SEGMENTS
from tasks.body import pose_fitting
from tasks.body.doubt import weights as weights_module
from tasks.body.doubt.evidence import gather_evidence
from tasks.body.doubt.probability import Weights, tell_doubt
from tasks.body.doubt.reasons import DoubtSettings
from tasks.settings import Settings
from tests.benchmarks.bodies.doubt_captures import MEASURED, TUNING, make_doubt_captures
from tests.benchmarks.bodies.doubt_learning import Lesson, learn_weights, parts_of, write_weights
from tests.benchmarks.bodies.poses import say, voxels_of
from tests.benchmarks.bodies.runs import Voxels
from tests.benchmarks.bodies.scores import LOST_M, joint_errors, longest_run
from tests.benchmarks.recordings import data_folder

SHARED = (
    "crossing",
    "lunge",
    "sleeves6",
    "nostart6",
    "child",
    "kimono",
    "plain",
    "martial",
    "spin",
)
"""The shared captures. Nothing is fitted on them."""

_NO_DOUBT = np.zeros((1, len(SEGMENTS)), np.float32)
"""In place of a doubt that is not asked for."""

MOSTLY = 0.5
"""A capture of which other reasons name a larger share of frames, or of which more are wrong,
teaches nothing of limbs that are lost for a while: its body was badly measured."""

BINS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 1.0)
"""Between which doubts reliability is told [probability]."""


def lesson_of(
    folder: Path, name: str, capture: Path, *, repaired: bool = True
) -> tuple[Lesson, NDArray[np.bool_]] | None:
    """Return what a capture teaches and what other reasons name, made once; None without a pose.

    Weights are learned from poses as they are before doubtful ones are repaired by them.
    """
    kept = folder / "evidence" / f"{name}.npz"
    kept.parent.mkdir(parents=True, exist_ok=True)
    if not kept.exists():
        try:
            voxels = voxels_of(folder, name, capture, _truth_of(capture))
            made = _digitize(voxels, capture, repaired=repaired)
        except InputError as error:
            say(f"{name}: no pose: {error}")
            return None
        np.savez_compressed(kept, **made)
    arrays = dict(np.load(kept))
    error, rate_hz = arrays.pop("error"), float(arrays.pop("rate_hz"))
    doubtful = arrays.pop("doubtful")
    plan = TUNING.get(name)
    dance = plan.dance.removesuffix("-mirrored") if plan else name
    return Lesson(arrays, error, rate_hz, dance), doubtful


def _truth_of(capture: Path) -> Path:
    """Return where the truth of a capture is."""
    return capture.with_name(f"{capture.name}_truth.npz")


def _digitize(voxels: Voxels, capture: Path, *, repaired: bool) -> dict[str, Any]:
    """Return the evidence of a take, its errors, its rate, and which frames other reasons name."""
    gathered: dict[str, Any] = {}
    repair = pose_fitting.doubt_and_repair

    def remember(fitted: Any, candidates: Any) -> Any:
        found, doubt = repair(fitted, candidates) if repaired else (fitted, _NO_DOUBT)
        gathered.update(gather_evidence(found, candidates))
        return found, doubt

    with patch.object(pose_fitting, "doubt_and_repair", remember):
        blocks = chain.make_poses(
            voxels.archive, voxels.recording, voxels.blocks, Settings(),
            run=lambda function, **parameters: function(**parameters),
            tell=lambda _stage, _end: None,
        )  # fmt: skip
    position, fit = (
        read_block(voxels.place, blocks[stage][0].block)
        for stage in ("joint_tracks", "pose_fitting")
    )
    error = joint_errors(position["position"], dict(np.load(_truth_of(capture))))
    others = fit["unmeasured"] | fit["unexplained"] | fit["cut_off"]
    return {**gathered, "error": error, "rate_hz": voxels.source.fps, "doubtful": others}


def doubt_of(
    lesson: Lesson, others: NDArray[np.bool_], weights: Any, settings: DoubtSettings
) -> NDArray[np.float64]:
    """Return (time, 11) how doubtful segments are, other reasons heard."""
    told = tell_doubt(lesson.evidence, lesson.rate_hz, weights).astype(np.float64)
    return np.maximum(told, settings.other_cause * others[:, None])


def left_out(lessons: Mapping[str, Lesson]) -> dict[str, Weights]:
    """Return for each capture weights that were learned without its dance."""
    part, found = parts_of(lessons.values()), {}
    for own in np.unique(part):
        others = [lesson for n, lesson in zip(part, lessons.values(), strict=True) if n != own]
        learned = learn_weights(others)
        found |= {name: learned for n, name in zip(part, lessons, strict=True) if n == own}
    return found


def table(
    lessons: Mapping[str, tuple[Lesson, NDArray[np.bool_]]],
    weights: Mapping[str, Weights],
    settings: DoubtSettings,
) -> dict[str, Any]:
    """Print how good doubt by each one's weights is on some captures; return the figures."""
    figures: dict[str, Any] = {}
    total, parts = np.zeros(3, int), []
    say("| capture | mean mm | lost | run unflagged | wrong | flagged | both |")
    say("| --- | --- | --- | --- | --- | --- | --- |")
    for name, (lesson, others) in lessons.items():
        doubt = doubt_of(lesson, others, weights[name], settings)
        lost = lesson.error > LOST_M
        wrong, said = lost.any(axis=1), doubt.max(axis=1) > settings.doubtful
        counts = [int(each.sum()) for each in (wrong & said, wrong, said)]
        total += counts
        parts.append((doubt.ravel(), lesson.wrong.ravel()))
        unsaid = longest_run(lost & ~said[:, None])
        mean = 1e3 * float(lesson.error[np.isfinite(lesson.error)].mean())
        say(
            f"| {name} | {mean:.1f} | {100 * lost.mean():.2f} % | {unsaid} | {counts[1]} | "
            f"{counts[2]} | {counts[0]} |"
        )
        figures[name] = {"mean_mm": mean, "lost": float(lost.mean()), "unsaid": unsaid,
                         "both": counts[0], "wrong": counts[1], "flagged": counts[2]}  # fmt: skip
    recall, precision = total[0] / max(total[1], 1), total[0] / max(total[2], 1)
    say(
        f"wrong frames that are flagged {recall:.2f}, flagged frames that are wrong {precision:.2f}"
    )
    say("| doubt of a segment | so often wrong | segments |\n| --- | --- | --- |")
    doubt, wrong = (np.concatenate(each) for each in zip(*parts, strict=True))
    for low, high in itertools.pairwise(BINS):
        own = (doubt >= low) & (doubt < high if high < 1 else doubt <= high)
        if own.any():
            say(f"| {doubt[own].mean():.3f} | {wrong[own].mean():.3f} | {own.sum()} |")
    return {**figures, "recall": recall, "precision": precision}


def main() -> None:
    """Read the command line, learn if wanted, and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path, help="kept: films, voxels and evidence")
    parser.add_argument("--learn", action="store_true", help="write the weights anew")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    films = args.folder / "films"
    settings = DoubtSettings()
    sets = {
        name: make_doubt_captures(films, data_folder(), plans)
        for name, plans in (("tuning", TUNING), ("measured", MEASURED))
    }
    sets["shared"] = {name: data_folder() / "captures" / name for name in SHARED}
    lessons = {
        which: {
            name: lesson
            for name, capture in captures.items()
            if (lesson := lesson_of(args.folder, name, capture, repaired=which != "tuning"))
        }
        for which, captures in sets.items()
    }
    weights: dict[str, Weights] = {}
    learned_weights: Weights = weights_module.WEIGHTS
    if args.learn:
        learned = {
            name: lesson
            for name, (lesson, others) in lessons["tuning"].items()
            if max(others.mean(), lesson.wrong.any(axis=1).mean()) < MOSTLY
        }
        learned_weights = learn_weights(learned.values())
        write_weights(Path(weights_module.__file__), learned_weights, learned)
        weights = left_out(learned)
    figures = {}
    for which, own in lessons.items():
        say(f"\n{which}")
        by_name = {name: weights.get(name, learned_weights) for name in own}
        figures[which] = table(own, by_name, settings)
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
