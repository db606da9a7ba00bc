"""How skin is learned in a take, and what is likely of face and hands."""

from dataclasses import dataclass, field

from tasks.body.anatomy.skin import SkinSettings
from tasks.body.extremities.candidates import CandidateSettings
from tasks.body.extremities.feet import FootSettings
from tasks.body.extremities.moves import Motion
from tasks.engine.settings import NotNegative, Positive, check_ranges

FACE_SPEED = 0.6
"""Typical speed of a face [statures a second]. Less than of a hand; chosen by eye on the shared
captures, not measured."""

FACE_FASTEST = 4.0
"""The most a face moves [statures a second]. Less than a hand; chosen by eye on the shared
captures, not measured."""


@dataclass(frozen=True)
class ExtremitySettings:
    """Everything that changes where hands, face and feet are found; lengths in statures.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    skin: SkinSettings = field(default_factory=SkinSettings)
    """How the color of skin is learned."""
    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    """Where hands and face could be."""
    feet: FootSettings = field(default_factory=FootSettings)
    """How feet are found."""
    hand_motion: Motion = field(default_factory=Motion)
    """How hands move."""
    face_motion: Motion = field(
        default_factory=lambda: Motion(speed=FACE_SPEED, fastest=FACE_FASTEST)
    )
    """How faces move. More slowly than hands; chosen by eye on the shared captures, not
    measured."""

    learn_s: NotNegative = 0.1
    """How near the initial frame the frames are from which skin is learned. The arms are still held
    there."""

    unseen: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which a hand or the face is not seen [nats]. Chosen by eye on
    the shared captures; not measured."""

    no_skin: NotNegative = 3.0
    """Cost of a frame (at 30 Hz) in which a hand is where no skin is, if hands differ from clothes
    [nats]. Chosen by eye on the shared captures; not measured."""

    some_skin: Positive = 0.25
    """Skin of a place from which `no_skin` costs nothing [as of the initial hand]. The rest may
    hide in a sleeve."""

    little_skin: NotNegative = 0.7
    """Cost, on top, of a hand of which nothing is seen [nats]. Half a hand costs half of it; chosen
    by eye on the shared captures, not measured."""

    no_end: NotNegative = 0.3
    """Cost of a frame (at 30 Hz) in which a hand is not an end of the surface [nats]. It grows as
    skin says less; chosen by eye on the shared captures, not measured."""

    usual_end: Positive = 0.22
    """How much the distance of a face from the top of the head may change [logarithm of the ratio
    to the first]. A neck is farther from it."""

    like_hand: NotNegative = 1.0
    """Cost of a frame (at 30 Hz) in which a face is as near an end of the surface as a hand is
    [nats]. With less than 1 a hand raised before the forehead was taken for the face in one of 26
    rendered captures, with 2 a face for a hand in another; in between nothing changed."""

    no_hair: NotNegative = 3.0
    """Cost of a frame (at 30 Hz) in which nothing of the head's other colors is around a face
    [nats]. As of no skin."""

    enough_hair: Positive = 1.5
    """By what these colors are multiplied before less than all of them costs [factor]. A third may
    be hidden; chosen, not measured."""

    together: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which both hands are one lump [nats]. As of one unseen, for one
    lump is no evidence of two hands. From there on more changes nothing."""

    at_face: NotNegative = 2.0
    """Cost of a frame (at 30 Hz) in which a hand is where the face or the throat is [nats]. They
    are skin without it; chosen by eye on the shared captures, not measured."""

    at_face_within: Positive = 0.06
    """How near the face a lump may well be the face itself [statures]. Half a head's depth; at
    twice that it surely is not."""

    at_neck_within: Positive = 0.037
    """How near the line from the middle of the head down to the base of the neck a lump may well be
    the neck's skin [statures]. Half a neck's depth; at twice that it surely is not. Of a rendered
    child the nape was taken for a hand for 40 frames; of 4000 hands of rendered captures that were
    right 1 in 160 came within 6 hundredths."""

    side: NotNegative = 0.07
    """Cost of a frame (at 30 Hz) in which a hand is as far on the other side as hands typically are
    on their own [nats]. Taken alone, it would be 2: but what a frame says of sides, the next
    repeats. With 0.2 arms that were crossed for two seconds were exchanged; of 45 rendered captures
    0.07 exchanged the hands of none where 0.2 did not."""

    typical_side: Positive = 0.13
    """How far to its side a hand typically is [statures]. Of twelve generated takes, the median."""

    plain_front: Positive = 0.015
    """How far skin lies before the middle of a head that surely faces there [statures]. Half as
    much is believed half; chosen by eye on the shared captures, not measured."""

    reach_slack: Positive = 0.06
    """How much farther from the neck than the outstretched hand was a hand may be before it costs
    [statures]. Shoulders rise, and the neck is known from the face only."""

    def __post_init__(self) -> None:
        check_ranges(self)
