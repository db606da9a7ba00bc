"""Generate performers whose truth is known, for the demo and the tests.

A performer dances movements one after another, as on one day: tempo, size and timing differ a
little from day to day and from repeat to repeat. What was danced when is returned with the
motion, so that a search of it can be judged (retrieval paper, section 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from storage.schema import JOINTS
from tasks.studio.dancing.choreography import (
    LOW,
    NEUTRAL,
    Movement,
    freely,
    lonely,
    mirrored,
    okuri48,
    okuri49,
    radio_arms,
    radio_knees,
    radio_sides,
    turning,
    wait,
    walk,
)
from tasks.studio.dancing.figure import CONTROLS, SIDES, Bones, measure_bones, pose_figure
from tasks.studio.dancing.footwork import carried_over, foot_track, walked_steps

REST_S = 0.9
"""Time from the last pose of a movement to the first of the next."""


@dataclass(frozen=True)
class Performer:
    """Who dances."""

    name: str
    height_m: float
    legs: float = 1.0
    """Length relative to the average for this height; so are the next two."""
    arms: float = 1.0
    shoulders: float = 1.0
    tempo: float = 1.0
    """Speed relative to how the movement is written."""

    @property
    def bones(self) -> Bones:
        """The lengths of this performer's body, metres."""
        return measure_bones(
            self.height_m, legs=self.legs, arms=self.arms, shoulders=self.shoulders
        )


TK = Performer("TK", 1.55, legs=0.98, tempo=1.0)
SH = Performer("SH", 1.68, arms=1.03, shoulders=0.96, tempo=0.93)
YS = Performer("YS", 1.80, legs=1.03, shoulders=1.06, tempo=1.08)


@dataclass(frozen=True)
class DancedClip:
    """What was danced from one frame to another, both inclusive."""

    movement: str
    start: int
    end: int
    performer: str


@dataclass(frozen=True)
class Performance:
    """A joint track and its truth."""

    position: NDArray[np.float64]
    """(time, joint, 3), metres, joints as in `storage.schema.JOINTS`."""
    rate_hz: float
    clips: tuple[DancedClip, ...]


def generate_performance(
    movements: Sequence[Movement],
    performer: Performer,
    *,
    day: int = 1,
    rate_hz: float = 60.0,
    place_m: tuple[float, float] = (0.0, 0.0),
    heading: float = 0.0,
    variation: float = 1.0,
) -> Performance:
    """Return a performer dancing these movements one after another.

    Parameters
    ----------
    movements : sequence of Movement
        See `tasks.studio.dancing.choreography`.
    performer : Performer
        Whose body and tempo.
    day : int
        Seed of everything that differs from day to day; the same day gives the same motion.
    rate_hz : float
        Frames a second.
    place_m : (x, z)
        Where on the floor the performer begins, metres.
    heading : float
        Where the performer looks at first: 0 is +z, growing to the left, radians.
    variation : float
        How much days and repeats differ: 1 as people do, 0 not at all.

    Returns
    -------
    Performance
        Feet that stand do not move, bones keep their length, the floor is y = 0. The clips
        are the movements in order; the rests between them belong to none.

    Raises
    ------
    ValueError
        Where there is no movement, or the rate is not positive.
    """
    if not movements or rate_hz <= 0.0:
        raise ValueError(
            f"a performance of {len(movements)} movements at {rate_hz} frames a second has no "
            "frames: give at least one movement and a positive rate"
        )
    rng = np.random.default_rng([day, *performer.name.encode()])
    danced, begins, second = [], [], 0.3
    for movement in movements:
        danced.append(_as_danced_today(movement, performer, rng, variation))
        begins.append(second)
        second += danced[-1].duration_s + REST_S * (1.0 + 0.15 * variation * rng.normal())
    frames = int(np.ceil((second - REST_S + 0.3) * rate_hz))
    time_s = np.arange(frames) / rate_hz
    controls = _will(danced, begins, time_s, rng, variation)
    position = _dance(danced, begins, performer, time_s, controls)
    clips = tuple(
        DancedClip(
            movement.name,
            round(begin * rate_hz),
            min(round((begin + movement.duration_s) * rate_hz), frames - 1),
            performer.name,
        )
        for begin, movement in zip(begins, danced, strict=True)
    )
    return Performance(_put_on_stage(position, place_m, heading), rate_hz, clips)


def _as_danced_today(
    movement: Movement, performer: Performer, rng: np.random.Generator, variation: float
) -> Movement:
    """Return the movement with today's tempo, timing and size."""
    tempo = performer.tempo * np.exp(np.clip(0.07 * variation * rng.normal(), -0.2, 0.2))
    duration_s = movement.duration_s / tempo
    early, late = 0.12 * variation * rng.uniform(-1.0, 1.0, 2)
    size = 1.0 + 0.05 * variation * float(rng.normal())
    stride = 1.0 + 0.05 * variation * float(rng.normal())

    def when(written_s: float) -> float:
        share = written_s / movement.duration_s
        bent = early * np.sin(np.pi * share) ** 2 + late * np.sin(2.0 * np.pi * share) / 2.0
        return float(duration_s * (share + bent / np.pi))

    poses = tuple(
        (
            when(second),
            {name: NEUTRAL[name] + (value - NEUTRAL[name]) * size for name, value in named.items()},
        )
        for second, named in movement.poses
    )
    steps = tuple(
        replace(
            step,
            start_s=when(step.start_s),
            end_s=when(step.end_s),
            left=step.left * stride,
            forward=step.forward * stride,
        )
        for step in movement.steps
    )
    return replace(movement, duration_s=duration_s, poses=poses, steps=steps)


def _dance(
    danced: list[Movement],
    begins: list[float],
    performer: Performer,
    time_s: NDArray[np.float64],
    controls: dict[str, NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the joints (time, joint, 3) of a performance that begins at the origin."""
    bones = performer.bones
    steps = walked_steps(danced, begins, performer.height_m)
    feet = {side: foot_track(steps, side, performer.height_m, bones, time_s) for side in SIDES}
    ground, yaw = carried_over(feet, steps, bones, time_s)
    for side, foot in feet.items():
        feet[side] = replace(foot, pitch=foot.pitch + controls["tiptoe"])
    joints = pose_figure(bones, controls, feet, ground, yaw)
    return np.stack([joints[name] for name in JOINTS], axis=1)


def _will(
    danced: list[Movement],
    begins: list[float],
    time_s: NDArray[np.float64],
    rng: np.random.Generator,
    variation: float,
) -> dict[str, NDArray[np.float64]]:
    """Return the track of every control: smooth through the poses, and never quite still."""
    seconds, poses = [], []
    for begin, movement in zip(begins, danced, strict=True):
        carried = dict(NEUTRAL)
        for second, named in movement.poses:
            carried = carried | named
            seconds.append(begin + second)
            poses.append([carried[name] for name in CONTROLS])
    through = PchipInterpolator(seconds, np.array(poses), extrapolate=False)
    tracks = through(np.clip(time_s, seconds[0], seconds[-1]))
    rate_hz = 1.0 / (time_s[1] - time_s[0])
    tracks = gaussian_filter1d(tracks, 0.085 * rate_hz, axis=0, mode="nearest")
    controls = {}
    for column, name in enumerate(CONTROLS):
        wobble = np.zeros_like(time_s)
        for hertz in rng.uniform(0.1, 0.8, 3):
            wobble += np.sin(2.0 * np.pi * (hertz * time_s + rng.uniform()))
        most = 0.0 if name in ("tiptoe", "crouch") else 0.012
        controls[name] = tracks[:, column] + variation * most * wobble
    return controls


def _put_on_stage(
    position: NDArray[np.float64], place_m: tuple[float, float], heading: float
) -> NDArray[np.float64]:
    """Turn a performance to its heading, then move it to its place."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return position @ turn.T + [place_m[0], 0.0, place_m[1]]


@dataclass(frozen=True)
class DemoTake:
    """One take of the demo's archive."""

    take: str
    title: str
    day: int
    performer: Performer
    performance: Performance


@dataclass(frozen=True)
class DemoSearch:
    """A search that the demo shows, and the clips that it should find."""

    question: str
    take: str
    start: int
    end: int
    part: str
    mirror: bool
    path_weight: float
    finds: tuple[tuple[str, DancedClip], ...]
    """(take, clip): every other place where it was danced."""


def demo_performances(
    *, rate_hz: float = 60.0
) -> tuple[tuple[DemoTake, ...], tuple[DemoSearch, ...]]:
    """Return the takes of the demo's archive, and the searches that it shows.

    Three performers of different size repeat the retrieval paper's movements on several days,
    with other movements before, between and after. The same frames every time.

    Parameters
    ----------
    rate_hz : float
        Frames a second of every take.
    """
    takes = tuple(
        DemoTake(
            f"{slug}-{performer.name.lower()}-day{day}",
            f"{title} ({performer.name}, day {day})",
            day,
            performer,
            generate_performance(
                movements,
                performer,
                day=10 * day + number,
                rate_hz=rate_hz,
                place_m=(0.4 * np.sin(number), 0.4 * np.cos(3.0 * number)),
                heading=1.1 * number,
            ),
        )
        for number, (slug, title, performer, day, movements) in enumerate(_demo_program())
    )
    return takes, _demo_searches(takes)


def _demo_program() -> list[tuple[str, str, Performer, int, list[Movement]]]:
    """Return slug, title, performer, day and movements of every take of the demo."""
    enter, back = walk(4), walk(8, turn=np.pi)
    low = walk(4, hands=LOW)
    radio = [radio_arms(), radio_sides(), radio_knees()]
    okuri = [low, okuri48(), wait(), mirrored(okuri48()), low, okuri48(), wait()]
    raised = [wait(3.0), low, okuri49(), wait(), mirrored(okuri49()), low, okuri49(), wait()]
    return [
        ("radio", "Radio exercise", TK, 1, [enter, *radio, freely(1), radio_arms()]),
        ("radio", "Radio exercise", TK, 2, [freely(2), *radio, back]),
        ("radio", "Radio exercise", YS, 2, [*radio, freely(3), *radio[:2], enter]),
        ("okuri48", "Okuri 48", TK, 1, [wait(), *okuri]),
        ("okuri48", "Okuri 48", TK, 2, [enter, freely(4), *okuri, back]),
        ("okuri49", "Okuri 49", TK, 1, raised),
        ("okuri49", "Okuri 49", SH, 3, [enter, *raised, freely(5)]),
        ("turn", "Turns", TK, 1, [wait(), turning("left"), low, turning("right"), low]),
        ("turn", "Turns", SH, 2, [turning("right"), freely(6), turning("left"), back]),
        ("lonely", "Lonely", TK, 1, [enter, lonely(), freely(7)]),
        ("lonely", "Lonely", SH, 2, [lonely(), enter, lonely(), freely(8), lonely(), back]),
        ("lonely", "Lonely", YS, 3, [freely(9), lonely(), enter, lonely()]),
    ]


def _demo_searches(takes: tuple[DemoTake, ...]) -> tuple[DemoSearch, ...]:
    """Return what the demo searches for; the section of the paper is in each question."""
    asked = (
        ("The same on another day (4.1)", "radio arms", "radio-tk-day1", "whole", False, 0.0),
        ("Okuri, the whole body (4.2)", "okuri 48", "okuri48-tk-day1", "whole", False, 0.0),
        ("Okuri to either side", "okuri 48", "okuri48-tk-day1", "whole", True, 0.0),
        ("Okuri, whatever the hands do (4.3)", "okuri", "okuri48-tk-day1", "feet", False, 0.0),
        ("A turn, whichever way (4.4)", "turn", "turn-tk-day1", "whole", False, 0.0),
        ("A turn to the left (4.4)", "turn left", "turn-tk-day1", "whole", False, 0.2),
        ("Lonely, by bodies of other size (4.5)", "lonely", "lonely-tk-day1", "whole", False, 0.0),
    )
    searches = []
    for question, movement, take, part, mirror, path_weight in asked:
        same = [
            (other.take, clip)
            for other in takes
            for clip in other.performance.clips
            if clip.movement.startswith(movement)
            and (mirror or not clip.movement.endswith("mirrored"))
        ]
        query = next(clip for name, clip in same if name == take)
        finds = tuple(pair for pair in same if pair != (take, query))
        searches.append(
            DemoSearch(question, take, query.start, query.end, part, mirror, path_weight, finds)
        )
    return tuple(searches)
