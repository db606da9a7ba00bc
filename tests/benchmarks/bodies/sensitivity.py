"""What the constants of the pose matter: each a quarter smaller and larger, one at a time.

The joints are those of the fit, before their ends are moved to those of the voxels.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from storage.schema import JOINTS
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.extremities.places import Extremities, find_extremities
from tasks.body.extremities.settings import ExtremitySettings
from tasks.body.initial.search import InitialModel, InitialModelSettings, find_initial_model
from tasks.body.pose_fitting import cues_of
from tasks.body.poses.joint import fit_poses
from tasks.body.poses.settings import JointMethodSettings
from tasks.geometry.voxels import VoxelRuns, join_runs, voxel_centers
from tasks.motion.stature import take_stature
from tests.benchmarks.bodies.runs import Voxels
from tests.benchmarks.bodies.scores import joint_errors, score_joints

CHANGES = (0.75, 1.25)


@dataclass(frozen=True)
class Settings:
    """All constants on the way from voxels to a pose."""

    joint: JointMethodSettings = field(default_factory=JointMethodSettings)
    extremities: ExtremitySettings = field(default_factory=ExtremitySettings)
    initial: InitialModelSettings = field(default_factory=InitialModelSettings)


def variations(settings: Any, path: str = "") -> Iterator[tuple[str, float, Any]]:
    """Yield name, new value and settings with one number changed, for every number."""
    for each in fields(settings):
        value, name = getattr(settings, each.name), f"{path}{each.name}"
        if is_dataclass(value):
            for inner, number, changed in variations(value, f"{name}."):
                yield inner, number, replace(settings, **{each.name: changed})
        elif isinstance(value, int | float) and not isinstance(value, bool):
            for change in CHANGES:
                number = round(value * change) if isinstance(value, int) else value * change
                yield name, number, replace(settings, **{each.name: number})


class Dancer:
    """The voxels of the first frames of a capture, read once, and what was made of them last."""

    def __init__(self, voxels: Voxels, truth: Path, most: int) -> None:
        self.frames = frames = voxels.frames
        self.grid, self.rate_hz = frames.grid, voxels.source.fps
        self.stature_m = voxels.source.stature_m
        count = min(len(frames), most)
        self.runs: list[VoxelRuns] = list(frames.hulls(0, count))
        self.surfaces: list[SurfaceFrame] = []
        self.indexed: list[tuple[Any, Any]] = []
        for n in range(count):
            is_surface, color, camera = frames.surface(n)
            index = frames.index(n)[is_surface]
            self.indexed.append((index, color))
            self.surfaces.append(SurfaceFrame(voxel_centers(self.grid, index), color, camera))
        known = np.load(truth)
        self.truth = {"joint_names": known["joint_names"], "joints": known["joints"][:count]}
        self.initial: dict[InitialModelSettings, InitialModel] = {}
        self.seen: dict[tuple[InitialModelSettings, ExtremitySettings], Extremities] = {}

    def model(self, settings: InitialModelSettings) -> InitialModel:
        """Return the initial model, found once for equal settings."""
        if settings not in self.initial:
            first = min(len(self.runs), math.ceil(settings.looked_at_s * self.rate_hz))
            self.initial[settings] = find_initial_model(
                join_runs(self.runs[:first]), self.grid, self.rate_hz,
                surfaces=self.indexed[:first], stature_m=self.stature_m, settings=settings,
            )  # fmt: skip
        return self.initial[settings]

    def extremities(self, settings: Settings) -> Extremities:
        """Return hands and face, found once for equal settings."""
        key = (settings.initial, settings.extremities)
        if key not in self.seen:
            found = self.model(settings.initial)
            stature_m = self.stature_m or take_stature(found.position[None])
            joints = dict(zip(JOINTS, found.position, strict=True))
            self.seen[key] = find_extremities(
                self.surfaces, self.rate_hz, stature_m, joints, initial_frame=found.frame,
                settings=settings.extremities,
            )  # fmt: skip
        return self.seen[key]

    def score(self, settings: Settings) -> dict[str, Any]:
        """Return mean error and lost share with these settings."""
        found, seen = self.model(settings.initial), self.extremities(settings)
        fitted = fit_poses(
            self.runs, self.grid, self.rate_hz, found.position, found.label,
            initial_frame=found.frame, surfaces=self.frames.surface, settings=settings.joint,
            **cues_of(seen),
        )  # fmt: skip
        score = score_joints(joint_errors(fitted.position, self.truth), fitted.doubtful)
        return {name: score[name] for name in ("mean_mm", "p95_mm", "lost", "run", "flagged")}


def measure_sensitivity(
    captures: Mapping[str, tuple[Voxels, Path]],
    most: int,
    say: Callable[[str], None],
    into: Path | None,
) -> dict[str, Any]:
    """Say and return the scores with each constant changed; keep them after each.

    Parameters
    ----------
    captures : mapping of (Voxels, truth)
        By name.
    most : int
        Frames of each that are looked at.
    say : function
        Prints a line.
    into : Path, optional
        Where to keep the figures while they come.
    """
    dancers = {name: Dancer(voxels, truth, most) for name, (voxels, truth) in captures.items()}
    usual = _scores(dancers, Settings())
    found: dict[str, Any] = {"frames": most, "default": usual, "changed": {}}
    say(f"| constant | value | {' | '.join(dancers)} |")
    say(f"|{' --- |' * (2 + len(dancers))}")
    say(_row("default", "", usual, None))
    for name, number, settings in variations(Settings()):
        scores = _scores(dancers, settings)
        found["changed"][f"{name} = {number:.6g}"] = scores
        say(_row(name, f"{number:.4g}", scores, usual))
        if into:
            into.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return found


def _scores(dancers: Mapping[str, Dancer], settings: Settings) -> dict[str, Any]:
    """Return the scores of all dancers, or what was said instead of one."""
    scores: dict[str, Any] = {}
    for name, dancer in dancers.items():
        try:
            scores[name] = dancer.score(settings)
        except ValueError as error:
            scores[name] = {"refused": str(error)}
    return scores


def _row(name: str, value: str, scores: dict[str, Any], usual: dict[str, Any] | None) -> str:
    """Return mean error in mm and lost share of each capture, and how they differ from usual."""
    cells = []
    for capture, score in scores.items():
        if "refused" in score:
            cells.append("refused")
            continue
        cell = f"{score['mean_mm']:.1f} mm, {100 * score['lost']:.2f} %"
        if usual and "mean_mm" in usual[capture]:
            more = score["mean_mm"] - usual[capture]["mean_mm"]
            lost = 100 * (score["lost"] - usual[capture]["lost"])
            cell += f" ({more:+.1f}, {lost:+.2f})"
        cells.append(cell)
    return f"| {name} | {value} | {' | '.join(cells)} |"
