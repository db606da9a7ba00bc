"""The words of the archive's arrays: joints, dims and units (DESIGN, section 2)."""

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
