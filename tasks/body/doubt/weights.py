"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.51,
        {},
    ),
    "UpperArm": (
        -6.12,
        {
            "now beside_other": 8.40,
            "while jerking_lower": 4.31,
            "now end_in_trunk": 3.56,
            "now crossed": 2.61,
            "now jerking_lower": 1.97,
            "while contested": 1.45,
            "moment unlike_end": 1.39,
            "now contested": 0.12,
        },
    ),
    "UpperLeg": (
        -8.79,
        {
            "while outside": 2.26,
            "now crossed": 2.00,
            "moment exchangeable": 1.79,
            "while off_sight": 1.21,
            "now far": 1.19,
            "moment crossed": 1.16,
            "now jerking_lower": 1.15,
            "moment jerking_lower": 1.13,
            "moment odd_foot": 1.12,
            "now exchangeable": 1.00,
            "while jerking_lower": 0.97,
            "moment outside": 0.93,
            "while foot_back": 0.82,
            "now odd_foot": 0.78,
            "now outside": 0.77,
            "while far": 0.74,
            "moment foot_back": 0.70,
            "moment far": 0.38,
        },
    ),
    "ForeArm": (
        -7.26,
        {
            "now beside_other": 11.54,
            "now end_in_trunk": 10.84,
            "now crossed": 4.14,
            "moment end_in_trunk": 3.67,
            "while contested": 2.89,
            "now jerking_lower": 2.57,
            "while jerking_lower": 1.64,
            "now handless": 1.50,
            "while unlike_end": 1.41,
            "moment unlike_end": 0.94,
            "now unlike_lower": 0.85,
            "moment handless": 0.62,
            "now unlike_end": 0.33,
        },
    ),
    "LowerLeg": (
        -7.04,
        {
            "while few_at_end": 2.77,
            "while beside_other": 2.54,
            "moment jerking_lower": 1.92,
            "while jerking_lower": 1.90,
            "while crossed": 1.79,
            "moment outside": 1.64,
            "now crossed": 1.16,
            "while off_sight": 1.13,
            "now far": 1.05,
            "now odd_foot": 0.79,
            "moment odd_foot": 0.76,
            "moment beside_other": 0.75,
            "now unlike_end": 0.70,
            "moment foot_back": 0.54,
            "now outside": 0.51,
            "moment far": 0.47,
            "now foot_back": 0.40,
            "while far": 0.27,
            "moment crossed": 0.26,
            "now beside_other": 0.19,
            "now jerking_lower": 0.18,
            "moment apart": 0.13,
            "while foot_back": 0.09,
            "moment unlike_end": 0.02,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
5460 frames of 42 captures that were made for it, 597 of them wrong.
"""
