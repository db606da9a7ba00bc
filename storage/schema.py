"""The words of the archive: joints, dims and units of its arrays, and how frames are written."""

import re

_SIDE = ("Shoulder", "Elbow", "Wrist", "Fin", "Hip", "Knee", "Ankle", "Heel", "Foot")

JOINTS: tuple[str, ...] = (
    "Head",
    "Neck",
    "Waist",
    *(f"R{name}" for name in _SIDE),
    *(f"L{name}" for name in _SIDE),
)
"""The 21 joints, in the order of every `joint` axis.

Head is the top of the head, Neck the base of the neck, Fin a finger tip, Foot a toe tip.
"""

SPACE = ("x", "y", "z")
"""The `space` axis: metres, right-handed, y up, floor at y = 0."""

SEGMENTS = (
    "Head", "Body", "Waist",
    "RUpperArm", "RForeArm", "LUpperArm", "LForeArm",
    "RUpperLeg", "RLowerLeg", "LUpperLeg", "LLowerLeg",
)  # fmt: skip
"""The segments of a body; a voxel's label is the place in this list plus one, 0 is none."""

NO_CAMERA = 255
"""The camera of a surface voxel that no camera sees [camera]. It is the largest number of a uint8;
a take has fewer cameras than that."""

_SHOWN = 40
"""How much of what is no range of frames is shown [characters]. Chosen: half a line."""


def parse_frames(text: str) -> tuple[int, int]:
    """Return START-END as two frames, both inclusive.

    Raises
    ------
    ValueError
        If it is not two whole numbers in order, of nine digits at most.
    """
    found = re.fullmatch(r"([0-9]{1,9})-([0-9]{1,9})", text)
    if not found or int(found[1]) > int(found[2]):
        shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        raise ValueError(f"frames {shown!r} should be START-END, such as 400-560")
    return int(found[1]), int(found[2])
