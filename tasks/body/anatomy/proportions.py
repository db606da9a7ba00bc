"""The proportions of a body, with their sources, and what follows from them alone.

Lengths are shares of the stature unless something else is said. Clothes hide most of a body, so
these numbers place what no camera sees. Points are metres with y up.

Sources: Drillis and Contini (1966) as printed in Winter, Biomechanics and Motor Control of Human
Movement; De Leva (1996); Dempster (1955); Bell et al. (1989); Boileau and Walch (1997); Staheli et
al. (1985); the ANSUR survey of 1988; of children Fredriks et al. (2005) and Bundak et al. (2014).
"Rigs" are the skeletons of motion capture.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

SPAN_PER_STATURE = 1.03
"""Span of the arms [statures]. Chosen by eye on the shared captures; not measured. The arms are
stretched when it is asked, the knees need not be."""

HEAD_ABOVE_ARMS = 0.20
"""From the line of stretched arms up to the top of the head [statures]. 0.182 by Drillis and
Contini to the shoulders' upper ends; with the span it tells the stature of somebody who
crouches."""

USUAL_REACH = 2.4
"""Half the span, usually [heights of the head above the arms' line]. 2.85 by Drillis and Contini to
the collar bone's outer end, 2.2 to 2.7 from the arms' line."""

LEAST_REACH = 2.1
"""Half the span at least, where both hands show [heights of the head above the arms' line]. A
little less than the least that was seen; see `USUAL_REACH`."""

LEAST_SPAN = 0.87
"""Span of the arms at least, where both hands show [heights of the performer]. A child's head is
large beside its arms as an adult's is that has lost both hands, but the arms span about the height
at all ages: 0.91 to 1.11 of a hull's in 24 captures of performers from 1.08 to 1.8 m, 0.75 without
hands, 0.84 with hands in sleeves."""

SHOULDER_SHARE = 0.20
"""From the middle of the body to a shoulder's joint [half spans]. 0.23 by Drillis and Contini for
the outer end of the collar bone, whose joint is farther in; rigs have 0.15 to 0.22."""

UPPER_ARM_SHARE = 0.40
"""Upper arm [lengths of the arm from shoulder to finger tip]. 0.423 by Drillis and Contini to a
stretched finger, 0.38 to 0.42 in rigs."""

FOREARM_SHARE = 0.37
"""Forearm [lengths of the arm from shoulder to finger tip]. 0.332 by Drillis and Contini to a
stretched finger, 0.35 to 0.40 in rigs."""

WRIST_SHARE = 0.62
"""From the elbow to the wrist [distances from elbow to finger tip]. It is what `FOREARM_SHARE` is
of the arm below the elbow, 0.617."""

HAND_LENGTH = 0.108
"""From wrist to finger tip [statures]. Drillis and Contini (1966)."""

HUMERAL_HEAD = 0.014
"""Radius of the head of the upper arm's bone [statures]. 23 mm (Boileau and Walch 1997)."""

NECK_SHARE = 0.25
"""From the arms' line up to the base of the neck [heights of the head above the arms' line]. There
the shoulders' slopes meet the neck; chosen by eye on the shared captures, not measured."""

FACE_BELOW_TOP = 0.45
"""From the top of the head down to the height of the face's skin [distances from neck to head].
Chosen by eye on the shared captures; not measured."""

FACE_AHEAD = 0.045
"""From the line through neck and head forward to the face's skin [statures]. Chosen by eye on the
shared captures; not measured. Half the depth of a head is 0.06."""

RIBS_BELOW_TOP = 0.336
"""From the top of the head down to the border of body and waist, where the ribs end [statures]. It
is midway between xiphion and omphalion (means of women and men, De Leva 1996). The hips, at 0.51
in that table, would tell it worse: by a third of what a body's legs are longer."""

WAIST_SHARE = 0.56
"""From the base of the neck down to the waist, where the loins begin [distances from neck to
hips]. Chosen by eye on the shared captures; not measured."""

HIPS_BELOW_TOP = 0.495
"""From the top of the head down to the middle of the hips [statures]. 0.470 by Drillis and Contini
to the bone beside the joint, which is 0.02 higher; 0.48 to 0.51 in rigs."""

GROWN_M = 1.45
"""Stature from which proportions are those of adults [m]. Girls and boys are so tall at 11 years,
not long before the share of the sitting height is an adult's (Bundak et al. 2014); adults who are
smaller are rare."""

TRUNK_OF_CHILDREN = 0.10
"""How much more of a child's stature is above the hips [statures / m below `GROWN_M`]. Sitting
height is 0.55 to 0.56 of the stature from 6 to 8.5 years, when children are 1.15 to 1.3 m tall, and
0.52 to 0.53 in adults (Bundak et al. 2014; Fredriks et al. 2005)."""

SMALLEST_M = 0.8
"""Stature below which proportions change no more [m]. Who is smaller does not stand yet."""

HIPS_ABOVE_FORK = 0.075
"""From where the legs of a hull meet up to the middle of the hips [statures]. The hip joint is
0.035 above the crotch (0.51 by De Leva 1996, 0.475 in the ANSUR survey of 1988), and a hull is
closed by some 6 cm of cloth and of what no camera sees between two thighs."""

HIP_SHARE = 0.0575
"""From the middle of the hips to a hip joint [statures]. 0.096 by Drillis and Contini is half the
width over the bones; the joint centers are 0.05 to 0.06 (Bell et al. 1989)."""

GROIN_RISE = 0.9
"""How far the border of waist and leg rises to the outside, along the groin [tangent of the angle].
Chosen by eye on the shared captures; not measured."""

FLATNESS = 0.70
"""Depth of a trunk [widths of the trunk]. Chosen by eye on the shared captures; not measured."""

THIGH_SHARE = 0.238
"""From hip to knee, where a knee is searched [statures]. 0.245 by Drillis and Contini; rigs have
0.23 to 0.25."""

PUBLISHED_THIGH = 0.245
"""From hip to knee as it was published [statures]. Drillis and Contini (1966)."""

SHANK_SHARE = 0.243
"""From knee to ankle [statures]. 0.246 by Drillis and Contini; rigs have 0.23 to 0.25."""

TOE_OUT = 10.0
"""How much farther outwards a foot points than its knee bends [degrees]. The thigh-foot angle of
adults (Staheli et al. 1985)."""

ANKLE_HEIGHT = 0.039
"""From the floor up to an ankle [statures]. Drillis and Contini (1966)."""

FOOT_LENGTH = 0.152
"""From heel to toe [statures]. Drillis and Contini (1966)."""

FOOT_HEIGHT = 0.06
"""From a foot's lowest voxel up to where the shin begins [statures]. Chosen by eye on the shared
captures; not measured."""

SOLE_HEIGHT = 0.014
"""From the floor up to the joints of heel and toe [statures]. Chosen by eye on the shared captures;
not measured."""

ANKLE_FROM_HEEL = 0.25
"""From the heel forward to the ankle [lengths of the foot]. Chosen by eye on the shared captures;
not measured."""

FOOT_PER_THIGH = 0.62
"""From heel to toe, where no stature is known [lengths of the thigh]. 0.620 by Drillis and Contini,
of 0.152 and 0.245 statures."""

ANKLE_PER_THIGH = 0.10
"""From the joint of the heel up to the ankle, where no stature is known [lengths of the thigh].
`ANKLE_HEIGHT` less `SOLE_HEIGHT` is 0.102 of `PUBLISHED_THIGH`."""

THICK_BONES = (
    (1, "Neck", "Head", 0.060, 0.055),
    (2, "Waist", "Neck", 0.085, 0.060),
    (3, "Hips", "Waist", 0.078, 0.085),
    *((4 + 2 * k, f"{s}Shoulder", f"{s}Elbow", 0.024, 0.046) for k, s in enumerate("RL")),
    *((5 + 2 * k, f"{s}Elbow", f"{s}Fin", 0.046, 0.046) for k, s in enumerate("RL")),
    *((8 + 2 * k, f"{s}Hip", f"{s}Knee", 0.076, 0.032) for k, s in enumerate("RL")),
    *((9 + 2 * k, f"{s}Knee", f"{s}Ankle", 0.032, 0.040) for k, s in enumerate("RL")),
    *((9 + 2 * k, f"{s}Heel", f"{s}Foot", 0.022, 0.018) for k, s in enumerate("RL")),
)
"""Label, first and last joint of each bone, and the body's radius around it at both [statures].
From the girths of adults over their statures; compare the radii in Drillis and Contini (1966)."""


def hips_below_top(stature_m: float) -> float:
    """Return how far the hips are below the top of the head, usually [statures].

    A child's legs are shorter.
    """
    missing = max(GROWN_M - max(stature_m, SMALLEST_M), 0.0)
    return HIPS_BELOW_TOP + TRUNK_OF_CHILDREN * missing


def leg_share(stature_m: float) -> float:
    """Return how long the legs usually are beside those of an adult, both in statures."""
    return (1.0 - hips_below_top(stature_m)) / (1.0 - HIPS_BELOW_TOP)


def complete_joints(joints: Mapping[str, Points]) -> dict[str, Points]:
    """Return joints (3,) with the waist, wrists, ankles and heels put in where they are missing."""
    whole = {name: np.asarray(place, np.float64) for name, place in joints.items()}
    whole = {name: place for name, place in whole.items() if np.isfinite(place).all()}
    hips = (whole["RHip"] + whole["LHip"]) / 2.0
    front = np.cross(whole["LHip"] - whole["RHip"], [0.0, 1.0, 0.0])
    whole.setdefault("Waist", whole["Neck"] + WAIST_SHARE * (hips - whole["Neck"]))
    for side in "RL":
        elbow, tip = whole[f"{side}Elbow"], whole[f"{side}Fin"]
        knee, toe = whole[f"{side}Knee"], whole[f"{side}Foot"]
        thigh = float(np.linalg.norm(knee - whole[f"{side}Hip"]))
        whole.setdefault(f"{side}Wrist", elbow + WRIST_SHARE * (tip - elbow))
        ahead = toe - whole[f"{side}Ankle"] if f"{side}Ankle" in whole else front
        along = unit(ahead * [1.0, 0.0, 1.0])
        whole.setdefault(f"{side}Heel", toe - FOOT_PER_THIGH * thigh * along)
        heel, above = whole[f"{side}Heel"], np.array([0.0, ANKLE_PER_THIGH * thigh, 0.0])
        whole.setdefault(f"{side}Ankle", heel + ANKLE_FROM_HEEL * (toe - heel) + above)
    return whole


def body_size(joints: Mapping[str, Points]) -> float:
    """Return the stature of the body that has these joints, metres."""

    def length(a: str, b: str) -> float:
        return float(np.linalg.norm(joints[a] - joints[b]))

    hips = (joints["RHip"] + joints["LHip"]) / 2.0
    trunk = length("Head", "Neck") + float(np.linalg.norm(joints["Neck"] - hips))
    legs = [length(f"{s}Hip", f"{s}Knee") + length(f"{s}Knee", f"{s}Ankle") for s in "RL"]
    return (trunk + sum(legs) / 2.0) / (1.0 - ANKLE_HEIGHT)


def unit(vector: Points) -> Points:
    """Return a vector of length 1; 0 where it has none."""
    return vector / max(float(np.linalg.norm(vector)), 1e-9)
