"""How a generated dance begins: with the arms stretched, so that the body can be measured."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.studio.dancing.limbs import unit


def stretch_arms_first(
    position: NDArray[np.float64], rate_hz: float, *, still_s: float = 1.0, blend_s: float = 1.0
) -> NDArray[np.float64]:
    """Return a track that begins with arms stretched sideways, then goes over into the dance.

    Parameters
    ----------
    position : (time, joint, 3) float64
        Metres, joints as in `storage.schema.JOINTS`.
    rate_hz : float
        Frames a second.
    still_s, blend_s : float
        How long the arms stay stretched, and how long they take to the first pose.

    Returns
    -------
    (time + round(still_s * rate_hz) + round(blend_s * rate_hz), joint, 3) float64
        The given frames come last; bones keep their lengths.
    """
    still, blend = round(still_s * rate_hz), round(blend_s * rate_hz)
    share = np.concatenate([np.zeros(still), np.arange(blend) / max(blend, 1)])
    share = (share**2 * (3.0 - 2.0 * share))[:, None]
    opening = np.repeat(position[:1], still + blend, axis=0)
    shoulders = position[0, JOINTS.index("LShoulder")] - position[0, JOINTS.index("RShoulder")]
    left = unit(shoulders * [1.0, 0.0, 1.0])
    for side, outward in (("R", -left), ("L", left)):
        chain = [JOINTS.index(side + name) for name in ("Shoulder", "Elbow", "Wrist", "Fin")]
        for before, after in pairwise(chain):
            bone = position[0, after] - position[0, before]
            along = unit(bone)
            aside = along - (along @ outward) * outward
            angle = share * math.acos(np.clip(along @ outward, -1.0, 1.0))
            turned = np.cos(angle) * outward + np.sin(angle) * unit(aside)
            opening[:, after] = opening[:, before] + np.linalg.norm(bone) * turned
    return np.concatenate([opening, position])
