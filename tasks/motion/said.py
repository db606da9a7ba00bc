"""What is said of the joints that were made of a motion file's markers, and of their gaps."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from storage.formats.motion.motion_file import MotionFile
from storage.schema import JOINTS
from tasks.geometry.runs import inner_runs
from tasks.motion.marker_choice import Choice
from tasks.motion.virtual_joints import plan_points

FEWEST_JOINTS = 6
"""How many joints a take has at least. Fewer are no body that a search could compare; chosen, not
measured."""
_NAMES_SAID = 60
"""How many names a message lists. Chosen, not measured."""

Positions = NDArray[np.float64]


def joint_faults(position: Positions, choice: Choice, motion: MotionFile) -> Iterator[str]:
    """Say which hips and how many joints are missing, and what the file has instead."""
    have = _joints_there(position)
    lost = [hip for hip in ("RHip", "LHip") if hip not in have]
    if not lost and len(have) >= FEWEST_JOINTS:
        return
    if lost:
        yield f"it has no {' and no '.join(lost)}, and the hips are the frame of the body"
    if len(have) < FEWEST_JOINTS:
        yield f"it has {len(have)} joints where at least {FEWEST_JOINTS} are wanted"
    near = f"the nearest marker set is {choice.marker_set}, which gives {', '.join(have)}"
    yield near if have else "no marker set makes a joint of its names"
    names = [name for name in motion.names if name.strip()]
    said = ", ".join(names[:_NAMES_SAID]) or "none"
    more = f" and {len(names) - _NAMES_SAID} more" if len(names) > _NAMES_SAID else ""
    yield f"its names are {said}{more}: say with --map which of them are joints"


def _joints_there(position: Positions) -> list[str]:
    return [name for i, name in enumerate(JOINTS) if np.isfinite(position[:, i]).any()]


def joint_notes(choice: Choice, position: Positions) -> Iterator[str]:
    """Say the marker set, which joints are virtual and how, and which are missing."""
    yield f"The markers were taken for the set {choice.marker_set}."
    ways: dict[str, list[str]] = {}
    for rule in plan_points(choice.recipes):
        ways.setdefault(rule.how, []).append(rule.point)
    for how, points in ways.items():
        yield f"Placed by rule, {' and '.join(points)}: {how}."
    have = _joints_there(position)
    if lost := [joint for joint in JOINTS if joint not in have]:
        yield f"Missing joints: {', '.join(lost)}."


def gap_notes(
    measured: Positions, whole: Positions, names: tuple[str, ...], longest: int
) -> Iterator[str]:
    """Say which gaps were filled, and which were too long for it."""
    before, after = np.isnan(measured[..., 0]), np.isnan(whole[..., 0])
    gone = before & ~after
    if gone.any():
        said = [names[i] for i in np.flatnonzero(gone.any(axis=0))]
        yield (
            f"Gaps of up to {longest} frames were filled by a cubic spline: {gone.sum()} frames of "
            f"{', '.join(said)}."
        )
    if after.any():
        lost = [(name, after[:, i]) for i, name in enumerate(names) if after[:, i].any()]
        said = [f"{name} {missing.sum()}" for name, missing in lost]
        longer = max((e - s for _, missing in lost for s, e in inner_runs(missing)), default=0)
        inner = f", the longest inside {longer} frames" if longer else ""
        yield f"Frames still missing (long gaps and ends{inner}): {', '.join(said)}."
