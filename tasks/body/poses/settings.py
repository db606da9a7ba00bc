"""What changes a pose that is fitted by the `joint` method."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge

from tasks.body.blobs.fitting import FitSettings
from tasks.engine.settings import (
    Count,
    CountOrNone,
    NotNegative,
    Positive,
    Share,
    check_ranges,
)


@dataclass(frozen=True)
class JointMethodSettings:
    """Everything that changes a pose fitted by the `joint` method.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    fit: FitSettings = field(default_factory=FitSettings)

    sample: Count = 2000
    """How many voxels of a frame are looked at, about [voxels]. 3500 change the mean error by less
    than 1 mm on six captures of seven, and take 30 % longer."""

    most_likeness: Annotated[float, Ge(1)] = 5.0
    """Factor by which a color that was seen on one bone only speaks for this bone at most [factor].
    Chosen by eye on the shared captures; not measured."""

    keep_moving: Share = 0.7
    """How much of a joint's last motion is expected to go on, at 30 frames a second. Chosen by eye
    on the shared captures; not measured."""

    hand_pull: NotNegative = 60.0
    """Information about the place of a hand that was surely seen, at a stature of 1.7 m [1/m²].
    Chosen by eye on the shared captures; not measured."""

    face_pull: NotNegative = 20.0
    """Information about the place of a face that was surely seen, at a stature of 1.7 m [1/m²].
    Chosen by eye on the shared captures; not measured."""

    foot_pull: NotNegative = 8.0
    """Information about the place of a foot that was surely seen, at a stature of 1.7 m [1/m²]. It
    is little, for voxels place a foot better where they show it. Chosen by eye on the shared
    captures; not measured."""

    foot_pull_followed: NotNegative = 20.0
    """As `foot_pull`, while the body is followed and its passes are merged [1/m²]. Under a skirt a
    leg goes to where its foot was seen, and voxels then place the foot. Of eighteen rendered
    captures seven lost more than 2 % of their joints with 8, and five with this."""

    pull_within: Positive = 0.15
    """Distance from which a place where something was seen pulls less [statures]. Chosen by eye on
    the shared captures; not measured."""

    lost_support: Share = 0.45
    """A limb of which a bone has less of its voxels is looked for elsewhere. Chosen by eye on the
    shared captures; not measured."""

    lost_distance: Positive = 0.09
    """A limb whose end is farther from where it was seen is looked for there [statures]. Chosen by
    eye on the shared captures; not measured."""

    free_end: Positive = 0.1
    """An end of the hull that is farther from all blobs may be a hand [statures]. Chosen by eye on
    the shared captures; not measured."""

    hand_missing: Positive = 0.1
    """A hand is put to a free end where the voxels become so much likelier [mean logarithm of their
    likelihoods]. It is 0.13 to 0.24 more where an arm had gone astray, and in single frames under a
    kimono."""

    hand_missing_s: Positive = 0.1
    """How long a hand must be at a free end at least. Chosen so that single frames under a kimono
    do not count."""

    side_apart: Positive = 0.09
    """Hands, or feet, that are nearer to each other may be one [statures]. It is about the length
    of a hand."""

    side_least_s: Positive = 0.1
    """How long a pair is apart at least where it is asked whether its sides are exchanged. An
    exchange that is over sooner is none."""

    side_frames: Count = 6
    """In how many frames of such a time at least it is asked whether sides are exchanged [frames].
    In a longer time it is one a second. Chosen by eye on the shared captures; not measured."""

    side_margin: NotNegative = 0.01
    """A pair may be exchanged where the voxels become less likely by no more than this [mean
    logarithm of their likelihoods]. In eighteen captures it was 0.016 or more where the pair was
    not exchanged."""

    swivels: Count = 4
    """How many places of the middle joint are tried where a limb is looked for [places]. Chosen by
    eye on the shared captures; not measured."""

    change_step: Positive = 0.05
    """A leap of such a length between the fits forwards and backwards costs 1 [statures]. Chosen by
    eye on the shared captures; not measured."""

    unexplained: Positive = 0.03
    """A fit in which the voxels of a frame are so much less likely costs 1 [mean logarithm of their
    likelihoods]. Chosen by eye on the shared captures; not measured."""

    alike: NotNegative = 0.02
    """Two fits of a limb that are nearer to each other are taken for one [statures]. Chosen by eye
    on the shared captures; not measured."""

    joint_rounds: CountOrNone = 6
    """How often joints and the poses that tell them are found in turn [rounds]. Chosen by eye on
    the shared captures; not measured."""

    joint_frames: Count = 40
    """How many frames tell the joints, evenly from the take [frames]. Chosen by eye on the shared
    captures; not measured."""

    settle_rounds: Count = 3
    """How often all frames are fitted again near their neighbors, with the joints found [rounds].
    Chosen by eye on the shared captures; not measured."""

    smoothing: NotNegative = 0.5
    """How much the two neighbors of a frame weigh together [times the frame itself]. Chosen by eye
    on the shared captures; not measured."""

    doubtful_support: Share = 0.35
    """A frame in which a segment has less of its voxels is doubtful. Chosen by eye on the shared
    captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)
