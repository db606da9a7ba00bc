"""Learn how much each evidence speaks against a limb, from captures of known truth.

It is logistic regression. Evidence may speak against a limb, never for it: no weight is negative,
so that what happens to be so in a few captures makes no other trusted. Most weights are driven to
nothing by a penalty (lasso, Tibshirani 1996); those that are left are fitted again without it. How
sure the sum may be is told by captures left out of the learning, in turn (Platt 1999): on its own
captures it is too sure. Captures of one dance are left out together, for they err alike.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from storage.schema import SEGMENTS
from tasks.body.doubt.evidence import ARMS, LEGS
from tasks.body.doubt.probability import LIMB_SEGMENTS, WINDOWS_S, Weights, windowed
from tests.benchmarks.bodies.scores import LOST_M, SCORED

Floats = NDArray[np.float64]

_ENDS = {"Head": ("Head", "Neck"), "Body": ("Neck", "RShoulder", "LShoulder"),
         "Waist": ("RHip", "LHip")}  # fmt: skip
for _side in "RL":
    for _segment, _joints in (
        ("UpperArm", ("Shoulder", "Elbow")), ("ForeArm", ("Elbow", "Fin")),
        ("UpperLeg", ("Hip", "Knee")), ("LowerLeg", ("Knee", "Foot")),
    ):  # fmt: skip
        _ENDS[_side + _segment] = tuple(_side + joint for joint in _joints)

_ASKED = {
    "Arm": "apart contested exchangeable crossed beside_other in_trunk end_in_trunk handless "
    "without_end few_lower jerking_lower unlike_lower unlike_end",
    "Leg": "apart contested exchangeable crossed beside_other far odd_foot foot_back beside_end "
    "few_at_end outside off_sight jerking_lower unlike_end",
}
"""The evidence that is asked of arms and of legs."""

_LASSO, _RIDGE = 20.0, 5.0
"""Penalties of a weight, and of half its square, of evidence in its standard deviations. Of five
pairs tried, the one that told most of captures left out of the learning (five parts in turn)."""

_PARTS = 5
"""In how many parts dances are left out in turn. Chosen, as usual."""

_LEAST = 0.02
"""Weights that stay below are nothing [per standard deviation]."""


@dataclass(frozen=True, eq=False)
class Lesson:
    """What a capture of known truth teaches."""

    evidence: dict[str, Floats]
    """(time, limb) of each kind, as `gather_evidence` returns it."""
    error: Floats
    """(time, 14) how far joints are off, m, as `joint_errors` returns it."""
    rate_hz: float
    dance: str = ""
    """What is danced."""

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """(time, 11) where a joint at an end of a segment is lost."""
        lost = self.error > LOST_M
        columns = [[SCORED.index(joint) for joint in _ENDS[name]] for name in SEGMENTS]
        return np.stack([lost[:, own].any(axis=1) for own in columns], axis=1)


def parts_of(lessons: Iterable[Lesson]) -> NDArray[np.int64]:
    """Return (capture,) the part in which each is left out, dances whole."""
    dances = [lesson.dance for lesson in lessons]
    order = list(dict.fromkeys(dances))
    return np.array([order.index(dance) % _PARTS for dance in dances])


def learn_weights(lessons: Iterable[Lesson]) -> Weights:
    """Return the base and the weights of each kind of segment."""
    lessons = list(lessons)
    part = parts_of(lessons)
    told = [windowed(lesson.evidence, lesson.rate_hz) for lesson in lessons]
    weights: Weights = {}
    for upper_or_lower in LIMB_SEGMENTS:
        for limbs in (range(len(upper_or_lower))[pair] for pair in (ARMS, LEGS)):
            names = [upper_or_lower[limb] for limb in limbs]
            kinds = [f"{w} {n}" for w in WINDOWS_S for n in _ASKED[names[0][-3:]].split()]
            rows = [
                np.concatenate(
                    [np.stack([each[kind][:, n] for kind in kinds], axis=1) for n in limbs]
                )
                for each in told
            ]
            wrong = [
                np.concatenate([lesson.wrong[:, SEGMENTS.index(name)] for name in names])
                for lesson in lessons
            ]
            weights[names[0][1:]] = _fit_soberly(kinds, rows, wrong, part)
    trunk = np.concatenate([lesson.wrong[:, :3].ravel() for lesson in lessons])
    often = (trunk.sum() + 1.0) / (len(trunk) + 2.0)  # rule of succession
    return {"trunk": (float(np.log(often / (1.0 - often))), {}), **weights}


def _fit_soberly(
    kinds: list[str], rows: list[Floats], wrong: list[NDArray[np.bool_]], part: NDArray[np.int64]
) -> tuple[float, dict[str, float]]:
    """Return base and weights of captures, as sure as they may be of captures left out."""
    odds = [np.empty(0)] * len(rows)
    for left_out in np.unique(part):
        left = np.flatnonzero(part != left_out)
        base, own = _fit(
            kinds, np.concatenate([rows[n] for n in left]), np.concatenate([wrong[n] for n in left])
        )
        weight = np.array([own.get(kind, 0.0) for kind in kinds])
        for n in np.flatnonzero(part == left_out):
            odds[n] = base + rows[n] @ weight
    shift, [share] = _regress(np.concatenate(odds)[:, None], np.concatenate(wrong), 0.0)
    base, own = _fit(kinds, np.concatenate(rows), np.concatenate(wrong))
    return shift + share * base, {kind: share * weight for kind, weight in own.items()}


def _fit(
    kinds: list[str], rows: Floats, wrong: NDArray[np.bool_]
) -> tuple[float, dict[str, float]]:
    """Return the base and the weights of the evidence that speaks."""
    spread = rows.std(axis=0) + 1e-6
    _, first = _regress(rows / spread, wrong, _LASSO)
    kept = np.flatnonzero(first > _LEAST)
    base, weight = _regress((rows / spread)[:, kept], wrong, 0.0)
    found = {kinds[k]: float(w / spread[k]) for k, w in zip(kept, weight, strict=True) if w > 0}
    return base, found


def _regress(rows: Floats, wrong: NDArray[np.bool_], lasso: float) -> tuple[float, Floats]:
    """Return base and weights, not negative, that make what is known likeliest."""
    sign = np.where(wrong, 1.0, -1.0)

    def cost(unknown: Floats) -> tuple[float, Floats]:
        base, weight = unknown[0], unknown[1:]
        margin = sign * (base + rows @ weight)
        slope = -sign / (1.0 + np.exp(margin))
        penalty = lasso * weight.sum() + 0.5 * _RIDGE * weight @ weight
        pull = np.append(slope.sum(), rows.T @ slope + lasso + _RIDGE * weight)
        return float(np.logaddexp(0.0, -margin).sum() + penalty), pull

    bounds = [(None, None)] + [(0.0, None)] * rows.shape[1]
    begin = np.zeros(1 + rows.shape[1])
    found = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(found[0]), found[1:]


def write_weights(path: Path, weights: Weights, captures: Mapping[str, Lesson]) -> None:
    """Write the module that holds the weights."""
    frames = sum(len(lesson.error) for lesson in captures.values())
    lost = sum(int(lesson.wrong.any(axis=1).sum()) for lesson in captures.values())
    lines = [
        '"""How much each evidence speaks against a segment.',
        "",
        "Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.",
        '"""',
        "",
        "WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {",
    ]
    for kind, (base, own) in weights.items():
        inner = [
            f'            "{n}": {w:.2f},' for n, w in sorted(own.items(), key=lambda x: -x[1])
        ]
        body = ["        {", *inner, "        },"] if inner else ["        {},"]
        lines += [f'    "{kind}": (', f"        {base:.2f},", *body, "    ),"]
    lines += [
        "}",
        '"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and',
        "what each evidence adds to it, times its size. The names are those of",
        "`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from",
        f"{frames} frames of {len(captures)} captures that were made for it, {lost} of them wrong.",
        '"""',
        "",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
