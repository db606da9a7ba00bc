"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.55,
        {},
    ),
    "UpperArm": (
        -4.54,
        {
            "while jerking_lower": 5.53,
            "now beside_other": 5.34,
            "now crossed": 5.10,
            "now jerking_lower": 1.95,
            "moment crossed": 1.65,
            "now unlike_lower": 1.43,
            "now contested": 1.12,
            "moment unlike_lower": 0.40,
        },
    ),
    "UpperLeg": (
        -12.59,
        {
            "now jerking_lower": 4.00,
            "moment outside": 3.73,
            "while crossed": 3.31,
            "moment jerking_lower": 2.95,
            "moment few_at_end": 2.94,
            "now foot_back": 2.32,
            "now far": 2.29,
            "now crossed": 2.28,
            "moment crossed": 2.16,
            "moment far": 1.91,
            "now few_at_end": 1.85,
            "now contested": 1.38,
            "while foot_back": 1.37,
            "moment unlike_end": 1.22,
            "now outside": 0.95,
            "while jerking_lower": 0.18,
            "moment apart": 0.02,
        },
    ),
    "ForeArm": (
        -8.12,
        {
            "while beside_other": 12.31,
            "now end_in_trunk": 9.81,
            "now beside_other": 8.42,
            "while contested": 3.61,
            "while jerking_lower": 2.95,
            "now crossed": 2.39,
            "now jerking_lower": 1.77,
            "while unlike_lower": 1.71,
            "moment unlike_lower": 1.65,
            "now handless": 1.50,
            "now unlike_lower": 1.24,
            "while unlike_end": 1.12,
            "moment handless": 0.88,
            "moment unlike_end": 0.21,
            "now apart": 0.12,
        },
    ),
    "LowerLeg": (
        -9.45,
        {
            "moment outside": 3.35,
            "while jerking_lower": 3.22,
            "moment jerking_lower": 2.33,
            "now exchangeable": 2.26,
            "while beside_other": 1.90,
            "now foot_back": 1.68,
            "while crossed": 1.67,
            "now far": 1.32,
            "now odd_foot": 1.28,
            "now jerking_lower": 1.26,
            "moment crossed": 1.26,
            "moment exchangeable": 1.19,
            "now few_at_end": 1.11,
            "moment few_at_end": 1.02,
            "moment far": 0.99,
            "now crossed": 0.95,
            "now outside": 0.65,
            "moment unlike_end": 0.42,
            "now contested": 0.09,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
5070 frames of 39 captures that were made for it, 367 of them wrong.
"""
