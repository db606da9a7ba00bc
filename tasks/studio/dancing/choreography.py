"""The movements that generated performers know, after the retrieval paper, section 4.

A movement is written as a dancer would learn it: poses at times, and steps. Poses carry on
what they do not name; steps are seen from where the movement began, facing forward.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.studio.dancing.figure import CONTROLS

Pose = dict[str, float]
Hand = tuple[float, float, float]

HANGING: Hand = (0.13, -0.95, 0.1)
"""Where a hand hangs, from its shoulder: outwards, up, forwards [arm's lengths]. By eye."""
LOW: Hand = (0.0, -0.72, 0.42)
"""Where a hand is held low before the body, likewise [arm's lengths]. By eye."""
LEANING = ("bow", "side", "twist", "look")
NEUTRAL: Pose = dict.fromkeys(CONTROLS, 0.0) | {
    f"{side}_{axis}": value
    for side in "RL"
    for axis, value in zip(("out", "up", "forward"), HANGING, strict=True)
}


@dataclass(frozen=True)
class Step:
    """One foot put down somewhere else."""

    foot: str
    """"R" or "L"."""
    start_s: float
    end_s: float
    left: float = 0.0
    """Where the body would stand over this foot, in shares of body height from where the
    movement began: to its left, and forward."""
    forward: float = 0.0
    turn: float = 0.0
    """Heading of the foot, radians to the left of where the movement began."""
    lift: float = 0.02
    """Highest the toes come, in shares of body height."""


@dataclass(frozen=True)
class Movement:
    """Poses and steps with a name."""

    name: str
    duration_s: float
    poses: tuple[tuple[float, Pose], ...]
    """(second, pose); the first is at 0, the last at the end."""
    steps: tuple[Step, ...] = ()


def pose(
    hands: Hand | None = None,
    *,
    right: Hand | None = None,
    left: Hand | None = None,
    **controls: float,
) -> Pose:
    """Return a pose: both hands or one, and any of the other controls by name."""
    named = dict(controls)
    for side, hand in (("R", right or hands), ("L", left or hands)):
        if hand is not None:
            named |= {f"{side}_out": hand[0], f"{side}_up": hand[1], f"{side}_forward": hand[2]}
    return named


def mirrored(movement: Movement) -> Movement:
    """Return the movement with left and right exchanged."""
    other = {"R": "L", "L": "R"}
    odd = ("side", "twist", "tilt", "look", "sway_left")

    def flip(name: str, value: float) -> tuple[str, float]:
        if name[:2] in ("R_", "L_"):
            return other[name[0]] + name[1:], value
        return name, -value if name in odd else value

    return replace(
        movement,
        name=f"{movement.name} mirrored",
        poses=tuple(
            (second, dict(flip(*item) for item in named.items()))
            for second, named in movement.poses
        ),
        steps=tuple(
            replace(step, foot=other[step.foot], left=-step.left, turn=-step.turn)
            for step in movement.steps
        ),
    )


def radio_arms() -> Movement:
    """Two arm circles outward, two inward, springing in the knees (4.1: fast)."""
    low, over = (-0.12, -0.8, 0.4), (0.12, 0.92, 0.22)
    front, aside = (-0.12, 0.05, 0.72), (0.93, 0.05, 0.02)
    beats, second = [(0.0, pose(HANGING))], 0.5
    for circle in [(low, front, over, aside)] * 2 + [(low, aside, over, front)] * 2:
        for hands, crouch in zip(circle, (0.07, 0.02, 0.0, 0.02), strict=True):
            beats.append((second, pose(hands, crouch=crouch, bow=crouch)))
            second += 0.3
    beats.append((second + 0.2, pose(HANGING, crouch=0.0, bow=0.0)))
    return Movement("radio arms", second + 0.2, tuple(beats))


def radio_sides() -> Movement:
    """One arm over the head, the body bent to the other side, twice each side."""
    over, waist = (-0.3, 0.9, 0.1), (0.3, -0.62, 0.12)
    beats, second = [(0.0, pose(HANGING)), (0.8, pose((0.9, 0.0, 0.0)))], 1.3
    for side, right, left in ((0.5, over, waist), (-0.5, waist, over)):
        for share in (1.0, 0.55, 1.0):
            beats.append((second, pose(right=right, left=left, side=share * side, tilt=0.3 * side)))
            second += 0.45
        beats.append((second + 0.1, pose((0.85, -0.3, 0.0), side=0.0, tilt=0.0)))
        second += 0.6
    beats.append((second + 0.2, pose(HANGING)))
    steps = (
        Step("L", 0.1, 0.6, left=0.12),
        Step("L", second - 0.4, second + 0.1),
    )
    return Movement("radio sides", second + 0.2, tuple(beats), steps)


def radio_knees() -> Movement:
    """Knee bends with the arms swung forward and up, ending on the toes."""
    beats, second = [(0.0, pose(HANGING))], 0.6
    for _ in range(3):
        beats += [
            (second, pose((0.06, 0.02, 0.93), crouch=0.22, bow=0.25)),
            (second + 0.5, pose((0.2, -0.88, -0.12), crouch=0.03, bow=0.1)),
        ]
        second += 1.0
    second += 0.35
    beats += [
        (second - 0.45, pose((0.12, 0.0, 0.9), crouch=0.0, bow=0.0)),
        (second + 0.1, pose((0.2, 0.94, 0.08), crouch=0.0, bow=-0.05, tiptoe=0.45)),
        (second + 0.9, pose((0.85, 0.2, 0.05), bow=0.0, tiptoe=0.4)),
        (second + 1.5, pose(HANGING, tiptoe=0.0)),
    ]
    return Movement("radio knees", second + 1.5, tuple(beats))


def _okuri(name: str, hands: tuple[Pose, ...]) -> Movement:
    """Three steps to the left: forward diagonal, the other foot in behind, leading again."""
    start, first, behind, again = hands
    carriage = {"crouch": 0.07, "bow": 0.06}
    poses = (
        (0.0, start | carriage),
        (1.1, first | {"twist": 0.22, "side": 0.08, "look": 0.15, "tilt": -0.1}),
        (2.1, behind | {"twist": -0.2, "side": -0.1, "look": 0.3, "crouch": 0.11}),
        (3.2, again | {"twist": 0.18, "side": 0.1, "look": -0.1, "tilt": 0.12, "crouch": 0.08}),
        (4.4, start | {"twist": 0.0, "side": 0.0, "look": 0.0, "tilt": 0.0, "crouch": 0.07}),
    )
    steps = (
        Step("L", 0.3, 1.0, left=0.15, forward=0.09, turn=0.15),
        Step("R", 1.3, 2.0, left=0.225, forward=-0.055, turn=-0.1),
        Step("L", 2.4, 3.1, left=0.35, forward=0.07, turn=0.1),
        Step("R", 3.4, 4.1, left=0.35, forward=0.07),
        Step("L", 4.12, 4.36, left=0.35, forward=0.07, lift=0.008),
    )
    return Movement(name, 4.4, poses, steps)


def okuri48() -> Movement:
    """Okuri with both hands below the hips (4.2)."""
    start = pose(LOW)
    sway = pose(right=(-0.06, -0.7, 0.45), left=(0.1, -0.74, 0.36))
    back = pose(right=(0.1, -0.74, 0.36), left=(-0.06, -0.7, 0.45))
    return _okuri("okuri 48", (start, sway, back, sway))


def okuri49() -> Movement:
    """Okuri with the same steps and both hands above the shoulders (4.3)."""
    start = pose((0.22, 0.4, 0.5))
    sway = pose(right=(0.1, 0.62, 0.5), left=(0.5, 0.42, 0.3))
    back = pose(right=(0.5, 0.45, 0.3), left=(0.1, 0.68, 0.45))
    return _okuri("okuri 49", (start, sway, back, sway))


def turning(side: str) -> Movement:
    """Turn about in seven steps, to the "left" or the "right", the body doing the same (4.4)."""
    sign = {"left": 1.0, "right": -1.0}[side]
    fan, roof = (0.55, 0.15, 0.62), (0.3, 0.8, 0.3)
    poses = (
        (0.0, pose(LOW, crouch=0.06)),
        (0.9, pose(right=(0.3, 0.1, 0.75), left=(0.3, -0.2, 0.6), crouch=0.09, nod=-0.05)),
        (1.9, pose(right=roof, left=fan, crouch=0.06, nod=-0.15, bow=-0.03)),
        (2.9, pose(right=fan, left=roof, nod=-0.1, bow=0.02)),
        (3.9, pose((0.35, -0.1, 0.65), nod=0.1, bow=0.1, crouch=0.1)),
        (4.8, pose(LOW, nod=0.0, bow=0.04, crouch=0.06)),
    )
    turns = [sign * np.pi * share for share in (0.16, 0.32, 0.5, 0.68, 0.86, 1.0, 1.0)]
    steps = tuple(
        Step("LR"[n % 2], 0.5 + 0.56 * n, 0.96 + 0.56 * n, turn=turn)
        for n, turn in enumerate(turns)
    )
    return Movement(f"turn {side}", 4.8, poses, steps)


def lonely() -> Movement:
    """Bowed, one slow step, the arms gather something to the breast and let it go (4.5)."""
    gather = pose(right=(-0.22, -0.3, 0.42), left=(-0.14, -0.38, 0.38))
    poses = (
        (0.0, pose(HANGING, bow=0.1, nod=0.15)),
        (1.6, pose((0.5, -0.45, 0.55), bow=0.3, nod=0.3, crouch=0.06)),
        (3.2, gather | pose(bow=0.52, nod=0.4, crouch=0.12, twist=0.12, side=0.06)),
        (4.2, gather | pose(bow=0.55, nod=0.45, twist=-0.16, side=-0.08, tilt=-0.15)),
        (5.6, pose(right=(0.05, -0.05, 0.8), left=(0.2, -0.6, 0.5), bow=0.3, nod=-0.1)),
        (6.6, pose(right=(0.3, -0.5, 0.6), bow=0.35, nod=0.3, twist=0.0, side=0.0, tilt=0.0)),
        (7.8, pose(HANGING, bow=0.1, nod=0.15, crouch=0.0)),
    )
    steps = (
        Step("R", 1.0, 2.2, forward=0.13, lift=0.03),
        Step("R", 6.2, 7.3, lift=0.02),
    )
    return Movement("lonely", 7.8, poses, steps)


def walk(steps: int = 4, *, turn: float = 0.0, hands: Hand = HANGING) -> Movement:
    """Walk forward with the arms swinging, or about a curve of `turn` radians in all."""
    pace, time_s = 0.2, 0.62
    poses, taken = [(0.0, pose(hands))], []
    left = forward = heading = 0.0
    for n in range(steps):
        foot, swing = "LR"[n % 2], 0.22 if n % 2 else -0.22
        last = n == steps - 1
        heading = turn if last else turn * (n + 0.5) / steps
        if not last:
            left += pace * np.sin(heading)
            forward += pace * np.cos(heading)
        begin = 0.2 + n * time_s
        taken.append(Step(foot, begin, begin + 0.52, left, forward, heading, lift=0.03))
        out, up, ahead = hands
        arms = pose(right=(out, up, ahead - swing), left=(out, up, ahead + swing))
        poses.append((begin + 0.45, arms | {"twist": -0.3 * swing}))
    taken.append(
        Step("LR"[steps % 2], 0.2 + steps * time_s, 0.7 + steps * time_s, left, forward, turn)
    )
    duration_s = 0.9 + steps * time_s
    return Movement(
        "walk", duration_s, (*poses, (duration_s, pose(hands) | {"twist": 0.0})), tuple(taken)
    )


def wait(duration_s: float = 2.0, *, hands: Hand = LOW) -> Movement:
    """Stand with the knees a little bent and shift the weight."""
    still = pose(hands, crouch=0.06, bow=0.05)
    return Movement(
        "wait",
        duration_s,
        (
            (0.0, still),
            (0.35 * duration_s, pose(sway_left=0.05, look=0.2, twist=0.06)),
            (0.7 * duration_s, pose(sway_left=-0.04, look=-0.15, twist=-0.05)),
            (duration_s, still | {"sway_left": 0.0, "look": 0.0, "twist": 0.0}),
        ),
    )


def freely(seed: int, duration_s: float = 4.0) -> Movement:
    """Gestures that nobody repeats: drawn at random, on the spot."""
    rng = np.random.default_rng(seed)
    beats = [(0.0, pose(HANGING))]
    for second in np.arange(0.9, duration_s - 0.5, 0.8):
        right, left = (
            (float(out), float(up), float(ahead))
            for out, up, ahead in zip(
                rng.uniform(0.2, 0.7, 2),
                rng.uniform(-0.7, 0.75, 2),
                rng.uniform(0.4, 0.65, 2),
                strict=True,
            )
        )
        lean = {name: float(rng.normal(0.0, 0.15)) for name in LEANING}
        lean["crouch"] = float(rng.uniform(0.0, 0.12))
        beats.append((float(second), pose(right=right, left=left) | lean))
    rest = dict.fromkeys((*LEANING, "crouch"), 0.0)
    return Movement("freely", duration_s, (*beats, (duration_s, pose(HANGING) | rest)))
