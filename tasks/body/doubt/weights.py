"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.46,
        {},
    ),
    "UpperArm": (
        -8.24,
        {
            "now beside_other": 12.36,
            "while jerking_lower": 8.15,
            "moment end_in_trunk": 7.84,
            "now crossed": 6.47,
            "now end_in_trunk": 5.22,
            "now jerking_lower": 2.86,
            "moment unlike_end": 2.71,
            "now in_trunk": 0.95,
        },
    ),
    "UpperLeg": (
        -10.80,
        {
            "now crossed": 3.02,
            "now odd_foot": 2.48,
            "now far": 2.45,
            "now jerking_lower": 2.31,
            "while foot_back": 1.68,
            "moment crossed": 1.59,
            "moment jerking_lower": 1.53,
            "while jerking_lower": 1.35,
            "moment far": 1.35,
            "now unlike_end": 1.26,
            "moment outside": 1.21,
            "now outside": 0.81,
            "moment foot_back": 0.69,
        },
    ),
    "ForeArm": (
        -7.79,
        {
            "now beside_other": 9.46,
            "now end_in_trunk": 8.65,
            "moment end_in_trunk": 8.08,
            "while jerking_lower": 6.20,
            "while beside_other": 5.35,
            "now crossed": 4.14,
            "now handless": 1.93,
            "now jerking_lower": 1.90,
            "now unlike_lower": 1.73,
            "while unlike_end": 0.92,
            "moment unlike_end": 0.76,
            "moment handless": 0.68,
        },
    ),
    "LowerLeg": (
        -6.39,
        {
            "while beside_other": 2.31,
            "while jerking_lower": 1.56,
            "while few_at_end": 1.54,
            "moment jerking_lower": 1.45,
            "while outside": 1.16,
            "while crossed": 1.15,
            "moment beside_other": 1.12,
            "now odd_foot": 1.06,
            "moment odd_foot": 0.92,
            "now far": 0.84,
            "now crossed": 0.81,
            "moment few_at_end": 0.81,
            "moment outside": 0.73,
            "while off_sight": 0.41,
            "now foot_back": 0.40,
            "moment far": 0.39,
            "now outside": 0.36,
            "moment crossed": 0.32,
            "now unlike_end": 0.31,
            "now jerking_lower": 0.26,
            "while far": 0.17,
            "moment apart": 0.02,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
5200 frames of 40 captures that were made for it, 418 of them wrong.
"""
