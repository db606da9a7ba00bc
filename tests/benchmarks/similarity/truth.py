"""Dance whose truth is known, for `tests.benchmarks.similarity.retrieval`."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from storage.schema import JOINTS
from tasks.motion.importing import ImportSettings, read_joint_track
from tasks.motion.stature import joints_present, measure_stature
from tasks.retrieval.normalization import OTHER_SIDE, pack_motion
from tasks.retrieval.searching import Query
from tasks.retrieval.segments import PackedTake
from tasks.studio.dancing import choreography as dances
from tasks.studio.performances import SH, TK, YS, Performer, generate_performance

RATE_HZ = 30.0
LEADS = ("salsa_01", "salsa_02", "salsa_03", "salsa_05")
FOLLOWS = ("salsa_16", "salsa_17", "salsa_18", "salsa_20")
PARTNER = dict(zip(LEADS + FOLLOWS, FOLLOWS + LEADS, strict=True))
"""The two dancers of a salsa were recorded at once: frame by frame they dance the same figure."""
_SALSA_HZ = 60.0
"""The files say 120 and were recorded at 60."""

PERFORMERS = (
    TK, SH, YS,
    Performer("MO", 1.48, legs=0.96, arms=0.97, shoulders=1.04, tempo=1.12),
    Performer("RI", 1.74, legs=1.02, arms=0.98, shoulders=0.94, tempo=0.9),
)  # fmt: skip
KINDS = {"okuri 48": "okuri", "okuri 49": "okuri", "okuri 48 mirrored": "okuri",
         "turn left": "turn", "turn right": "turn"}  # fmt: skip
"""Movements that share a part of the body, or all but a side: neither the same nor different."""


@dataclass(frozen=True)
class Danced:
    """A clip of which it is known what is danced."""

    take: str
    performer: str
    movement: str
    start: int
    end: int


def style_of(take: str) -> str:
    """Return what a recorded take dances: indian, martial or salsa."""
    return take.split("_")[0]


def read_recorded(folder: Path) -> dict[str, tuple[PackedTake, NDArray[np.float64]]]:
    """Return the recorded takes by name: packed, and their positions (sample, 21, 3) in metres."""
    found = {}
    for file in sorted(folder.glob("*/*.bvh")):
        track, _ = read_joint_track(file, ImportSettings())
        rate_hz = _SALSA_HZ if style_of(file.stem) == "salsa" else track.rate_hz
        position = track.position[:: round(rate_hz / RATE_HZ)].astype(np.float64)
        found[file.stem] = packed(file.stem, position), position
    return found


def packed(name: str, position: NDArray[np.float64]) -> PackedTake:
    """Return a motion at the index rate as the search reads it."""
    rows = pack_motion(position, RATE_HZ, measure_stature(position, JOINTS) or 1.6)
    return PackedTake(name, rows, RATE_HZ, len(position), joints_present(position))


def cut(take: PackedTake, start: int, end: int) -> Query:
    """Return the clip from `start` to `end`, inclusive, as a query."""
    return Query(take.rows[:, start : end + 1], take.joints_present, f"{take.name}:{start}-{end}")


def generate(performers: int, days: int) -> tuple[dict[str, PackedTake], list[Danced]]:
    """Return takes of performers who dance 14 movements on each of several days, and the clips."""
    movements = [
        dances.radio_arms(), dances.radio_sides(), dances.radio_knees(), dances.okuri48(),
        dances.okuri49(), dances.mirrored(dances.okuri48()), dances.turning("left"),
        dances.turning("right"), dances.lonely(), dances.walk(6),
        *(replace(dances.freely(seed), name=f"freely {seed}") for seed in range(11, 15)),
    ]  # fmt: skip
    takes, clips = {}, []
    for number, performer in enumerate(PERFORMERS[:performers]):
        for day in range(1, days + 1):
            order = np.random.default_rng([day, number]).permutation(len(movements))
            danced = [movements[which] for which in order]
            performance = generate_performance(danced, performer, day=100 + day, rate_hz=RATE_HZ)
            name = f"{performer.name}-{day}"
            takes[name] = packed(name, performance.position)
            clips += [
                Danced(name, performer.name, clip.movement, clip.start, clip.end)
                for clip in performance.clips
            ]
    return takes, clips


def variants(
    position: NDArray[np.float64], start: int, end: int, rng: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Return a clip of a motion altered in every way that a search should see through, by name."""
    clip = position[start : end + 1]
    arm = [JOINTS.index(f"R{name}") for name in ("Elbow", "Wrist", "Fin")]
    dropped = clip.copy()
    shoulder = dropped[:, [JOINTS.index("RShoulder")]]
    dropped[:, arm] = shoulder + np.array([[0, -0.28, 0], [0, -0.53, 0], [0, -0.7, 0]])
    slow = gaussian_filter1d(clip, 5.0, axis=0, mode="nearest")
    mean = clip.mean(axis=0)
    return {
        "as it was": clip,
        "30 % slower": _retimed(clip, round(1.3 * len(clip)), rng),
        "30 % faster": _retimed(clip, round(0.7 * len(clip)), rng),
        "noise of 1 cm": clip + gaussian_filter1d(rng.normal(size=clip.shape), 1.0, axis=0) * 0.019,
        "other heading": _turned(clip, 2.0),
        "other limbs": _with_other_limbs(clip),
        "style: larger by a fifth": mean + 1.2 * (clip - mean) + 0.2 * (slow - clip),
        "mirrored": _mirrored(clip),
        "one arm dropped": dropped,
    }


def planted(
    name: str, filler: NDArray[np.float64], variant: NDArray[np.float64]
) -> tuple[PackedTake, int, int]:
    """Return a take that dances a variant in the middle of something else, and where."""
    before = filler[: len(variant)]
    take, middle = packed(name, np.concatenate([before, before])), packed(name, variant)
    rows = np.concatenate(
        [take.rows[:, : len(before)], middle.rows, take.rows[:, len(before) :]], 1
    )
    start, end = len(before), len(before) + len(variant) - 1
    return PackedTake(name, rows, RATE_HZ, rows.shape[1], middle.joints_present), start, end


def overlap(a: tuple[int, int], b: tuple[int, int]) -> float:
    """Return the frames that two clips share over those that either has."""
    shared = min(a[1], b[1]) - max(a[0], b[0]) + 1
    return max(shared, 0) / (max(a[1], b[1]) - min(a[0], b[0]) + 1)


def _retimed(
    clip: NDArray[np.float64], frames: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a clip stretched unevenly to that many frames."""
    pace = 1 + 0.25 * np.sin(np.linspace(0, 2 * np.pi, frames) + rng.uniform(0, 6))
    at = np.cumsum(pace) - pace[0]
    at *= (len(clip) - 1) / at[-1]
    flat = clip.reshape(len(clip), -1)
    moved = [np.interp(at, np.arange(len(clip)), column) for column in flat.T]
    return np.array(moved).T.reshape(frames, *clip.shape[1:])


def _turned(clip: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return a clip turned about the vertical, and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return clip @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + [3.0, 0.0, -2.0]


def _mirrored(clip: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a clip with left and right exchanged."""
    return clip[:, OTHER_SIDE] * [-1.0, 1.0, 1.0]


def _with_other_limbs(clip: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a clip danced with legs 6 % longer, arms 6 % shorter and a longer trunk."""
    longer = {"Knee": ("Hip", 1.06), "Ankle": ("Knee", 1.06), "Heel": ("Ankle", 1.0),
              "Foot": ("Ankle", 1.0), "Elbow": ("Shoulder", 0.94), "Wrist": ("Elbow", 0.94),
              "Fin": ("Wrist", 0.94)}  # fmt: skip
    made = clip.copy()
    hips = clip[:, [JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=1)
    for joint in ("Head", "Neck", "Waist", "RShoulder", "LShoulder"):
        k = JOINTS.index(joint)
        made[:, k] = hips + 1.04 * (clip[:, k] - hips)
    for side in "RL":
        for name, (parent, factor) in longer.items():
            k, p = JOINTS.index(side + name), JOINTS.index(side + parent)
            made[:, k] = made[:, p] + factor * (clip[:, k] - clip[:, p])
    return made
