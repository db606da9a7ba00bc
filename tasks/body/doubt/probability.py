"""Make of the evidence against limbs how likely each segment is in the wrong place.

A segment is in the wrong place where a joint at one of its ends is more than 15 cm off. The
logarithm of the odds is a sum of weighted evidence (logistic regression). Evidence is taken now,
and in the mean of a moment and of a while, for limbs are lost for some frames on end.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from storage.schema import SEGMENTS
from tasks.body.doubt.evidence import Evidence
from tasks.body.doubt.weights import WEIGHTS

Weights = dict[str, tuple[float, dict[str, float]]]
"""As `weights.WEIGHTS`."""

WINDOWS_S = {"now": 1 / 30, "moment": 0.1, "while": 0.4}
"""How far before and after a frame evidence is averaged. Now, so that doubt ends where a limb is
found again; a moment, so that the noise of single frames goes; a while, so that what is odd now and
then counts; chosen, not measured."""

LIMB_SEGMENTS = (
    ("RUpperArm", "LUpperArm", "RUpperLeg", "LUpperLeg"),
    ("RForeArm", "LForeArm", "RLowerLeg", "LLowerLeg"),
)
"""The upper and the lower segment of each limb, in the order of the evidence."""


def windowed(evidence: Evidence, rate_hz: float) -> Evidence:
    """Return evidence (time, limb) in the mean of each window, named `<window> <name>`."""
    found = {}
    for window, reach_s in WINDOWS_S.items():
        frames = 2 * max(1, round(reach_s * rate_hz)) + 1
        for name, values in evidence.items():
            mean = uniform_filter1d(values, frames, axis=0, mode="nearest")
            found[f"{window} {name}"] = mean
    return found


def tell_doubt(
    evidence: Evidence, rate_hz: float, weights: Weights = WEIGHTS
) -> NDArray[np.float32]:
    """Return (time, 11) how likely each segment is in the wrong place.

    Parameters
    ----------
    evidence
        (time, limb) of each kind, as `gather_evidence` returns it.
    rate_hz
        Frames a second.
    weights
        How much each evidence counts.

    Returns
    -------
    (time, 11) float32
        0 to 1, segments as in `storage.schema.SEGMENTS`. Of head, body and waist nothing is asked
        but how often they are wrong; they rarely are.
    """
    told = windowed(evidence, rate_hz)
    frames = len(next(iter(evidence.values())))
    doubt = np.empty((frames, len(SEGMENTS)))
    for segment, name in enumerate(SEGMENTS):
        side = name[0] in "RL"
        base, own = weights[name[1:] if side else "trunk"]
        odds = np.full(frames, base)
        if side:
            limb = next(pair for pair in LIMB_SEGMENTS if name in pair).index(name)
            for kind, weight in own.items():
                odds += weight * told[kind][:, limb]
        doubt[:, segment] = 1.0 / (1.0 + np.exp(-odds))
    return doubt.astype(np.float32)
