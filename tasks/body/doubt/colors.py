"""Ask whether a limb, where the pose has it, wears what it wears in the rest of the take.

What the posed body would look like, rendered back into the films, is learned from the take itself:
the colors that forearms, hands, shanks and feet cover in all other frames. Of most of these the
pose is right. Colors that the initial frame shows are fewer, and in one light.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.body.anatomy.bones import BONES
from tasks.body.anatomy.colors import COLORS, log_ratio, spread_counts
from tasks.body.poses.limbs import LIMBS

Floats = NDArray[np.float64]

_PARTS = ("ForeArm", "Hand", "LowerLeg", "Foot")
"""The bones whose colors are asked, of either side. Thighs and upper arms are under too much."""

_LEFT_OUT_S = 1.0
"""How long before and after a frame its colors are not learned from, at least [s]. A limb that is
lost there would vouch for itself; chosen, not measured."""

_BLOCKS = 20
"""In how many blocks of frames at most colors are learned [blocks]. So a long take costs no more;
chosen."""

_MOST_TOLD = 2.0
"""What a color tells at most [nats]. As a hand's (`candidates`)."""

_LEAST = 3
"""Of fewer voxels colors tell nothing [voxels]. Chosen, not measured."""

_MOST_UNLIKE = 2.0
"""More is not more doubtful [nats]. It is `_MOST_TOLD`."""


def tell_unlike(
    bones: Sequence[NDArray[np.integer]], cells: Sequence[NDArray[np.integer]], rate_hz: float
) -> dict[str, Floats]:
    """Return how unlike the colors of limbs are to what they wear in the rest of the take.

    Parameters
    ----------
    bones
        A frame each: (voxel,) the bone that a voxel is of, -1 for none.
    cells
        A frame each: (voxel,) the cell of its color (`anatomy.colors`), -1 for none.
    rate_hz
        Frames a second.

    Returns
    -------
    dict of (time, 4) float64
        `unlike_lower` and `unlike_end`, by limb: nats more than usual, 0 to 2; 0 throughout in a
        take that is too short to leave anything out.
    """
    frames = len(bones)
    block = max(1, round(_LEFT_OUT_S * rate_hz), -(-frames // _BLOCKS))
    part = np.array([_part_of(name) for name in BONES] + [-1])
    worn = [_keep(part[own], cell) for own, cell in zip(bones, cells, strict=True)]
    total = _count(worn)
    unlike = np.zeros((frames, len(LIMBS), 2))
    for first in range(0, frames, block):
        count = total - _count(worn[max(first - block, 0) : first + 2 * block])
        ratio = _learn(count)
        for t in range(first, min(first + block, frames)):
            for n, limb in enumerate(LIMBS):
                for k, bone in enumerate((limb.lower, limb.end)):
                    own = cells[t][(bones[t] == bone) & (cells[t] >= 0)]
                    if len(own) >= _LEAST:
                        unlike[t, n, k] = -ratio[part[bone], own].mean()
    by_pair = unlike.reshape(frames, 2, 2, 2)
    usual = np.median(by_pair.transpose(1, 3, 0, 2).reshape(2, 2, -1), axis=2)
    more = np.clip(by_pair - usual[None, :, None], 0.0, _MOST_UNLIKE).reshape(unlike.shape)
    return {"unlike_lower": more[..., 0], "unlike_end": more[..., 1]}


def _part_of(bone: str) -> int:
    """Return which part a bone is of; one more than the last of all others."""
    return _PARTS.index(bone[1:]) if bone[1:] in _PARTS else len(_PARTS)


def _keep(
    part: NDArray[np.integer], cell: NDArray[np.integer]
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return part and cell of the voxels that have both."""
    own = (part >= 0) & (cell >= 0)
    return part[own], cell[own]


def _count(
    worn: Sequence[tuple[NDArray[np.integer], NDArray[np.integer]]],
) -> NDArray[np.int64]:
    """Return (part + 1, cell) how often colors are on the parts, and elsewhere, in some frames."""
    parts = len(_PARTS) + 1
    place = np.concatenate([part * COLORS + cell for part, cell in worn])
    return np.bincount(place, minlength=parts * COLORS).reshape(parts, COLORS)


def _learn(count: NDArray[np.int64]) -> Floats:
    """Return (part, cell) how much likelier colors are on the parts than anywhere [logarithm]."""
    anywhere = spread_counts(count.sum(axis=0))
    ratio = [log_ratio(spread_counts(own), anywhere) for own in count[:-1]]
    return np.clip(np.array(ratio), -_MOST_TOLD, _MOST_TOLD)
