"""Where a performer's feet stand and step, and where the hips are carried meanwhile."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tasks.studio.dancing.choreography import Movement, Step
from tasks.studio.dancing.figure import SIDES, Bones, FootTrack
from tasks.studio.dancing.limbs import facing

STANCE = 0.055
"""How far a foot stands beside the middle of the body, in shares of body height."""
TOE_OUT = 0.1
"""How far a foot turns out, radians."""


def walked_steps(
    danced: Sequence[Movement], begins: Sequence[float], height_m: float
) -> list[Step]:
    """Return every step with its time, place and heading in the whole performance."""
    steps: list[Step] = []
    left = forward = heading = 0.0
    for begin, movement in zip(begins, danced, strict=True):
        c, s = np.cos(heading), np.sin(heading)
        walked = [
            replace(
                step,
                start_s=begin + step.start_s,
                end_s=begin + step.end_s,
                left=left + height_m * (c * step.left + s * step.forward),
                forward=forward + height_m * (c * step.forward - s * step.left),
                turn=heading + step.turn,
                lift=height_m * step.lift,
            )
            for step in movement.steps
        ]
        steps += walked
        if walked:
            last = max(walked, key=lambda step: step.end_s)
            left, forward, heading = last.left, last.forward, last.turn
    return steps


def foot_track(
    steps: list[Step], side: str, height_m: float, bones: Bones, time_s: NDArray[np.float64]
) -> FootTrack:
    """Return one foot that stands between its steps."""
    sign = SIDES[side]

    def toe(left: float, forward: float, turn: float) -> NDArray[np.float64]:
        across, yaw = height_m * sign * STANCE, turn + sign * TOE_OUT
        return np.array(
            [
                left + across * np.cos(turn) + bones.foot * np.sin(yaw),
                0.0,
                forward - across * np.sin(turn) + bones.foot * np.cos(yaw),
                yaw,
            ]
        )

    here = toe(0.0, 0.0, 0.0)
    track = np.tile(here, (len(time_s), 1))
    pitch = np.zeros_like(time_s)
    for step in (step for step in steps if step.foot == side):
        there = toe(step.left, step.forward, step.turn)
        share = np.clip((time_s - step.start_s) / (step.end_s - step.start_s), 0.0, 1.0)
        track += (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, None] * (there - here)
        up = np.sin(np.pi * share) ** 2
        track[:, 1] += step.lift * up
        pitch += min(8.0 * step.lift, 0.45) * up * (1.0 - 0.5 * share)
        here = there
    return FootTrack(track[:, :3], track[:, 3], pitch)


def carried_over(
    feet: dict[str, FootTrack], steps: list[Step], bones: Bones, time_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where on the floor (time, 3) the hips are carried, and the pelvis's heading.

    The hips lean over the foot that stands while the other steps, and lie midway otherwise.
    """
    rate_hz = 1.0 / (time_s[1] - time_s[0])
    load, under = {}, {}
    for side, foot in feet.items():
        swings = (
            _swing(time_s, step.start_s - 0.2, step.end_s + 0.15)
            for step in steps
            if step.foot == side
        )
        load[side] = 1.0 - 0.8 * np.clip(sum(swings, np.zeros_like(time_s)), 0.0, 1.0)
        under[side] = foot.toe - bones.foot * facing(foot.yaw)
    share = (load["L"] / (load["L"] + load["R"]))[:, None]
    ground = (share * under["L"] + (1.0 - share) * under["R"]) * [1.0, 0.0, 1.0]
    yaw = 0.5 * (feet["L"].yaw + feet["R"].yaw)
    return (
        gaussian_filter1d(ground, 0.12 * rate_hz, axis=0, mode="nearest"),
        gaussian_filter1d(yaw, 0.15 * rate_hz, mode="nearest"),
    )


def _swing(time_s: NDArray[np.float64], start_s: float, end_s: float) -> NDArray[np.float64]:
    """Return 1 inside a step and 0 outside, smooth over the first and last 0.2 s."""
    inside = np.minimum(time_s - start_s, end_s - time_s) / 0.2
    return np.sin(0.5 * np.pi * np.clip(inside, 0.0, 1.0)) ** 2
