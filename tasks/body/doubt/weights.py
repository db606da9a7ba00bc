"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -8.22,
        {},
    ),
    "UpperArm": (
        -4.53,
        {
            "while jerking_lower": 5.49,
            "now beside_other": 5.32,
            "now crossed": 5.07,
            "now jerking_lower": 1.94,
            "moment crossed": 1.65,
            "now unlike_lower": 1.44,
            "now contested": 1.11,
            "moment unlike_lower": 0.41,
        },
    ),
    "UpperLeg": (
        -10.69,
        {
            "moment outside": 3.60,
            "now jerking_lower": 3.34,
            "moment few_at_end": 2.53,
            "now crossed": 2.34,
            "while crossed": 1.96,
            "now far": 1.88,
            "moment crossed": 1.85,
            "moment far": 1.68,
            "while foot_back": 1.67,
            "now few_at_end": 1.50,
            "now foot_back": 1.39,
            "while jerking_lower": 1.31,
            "now contested": 1.16,
            "while unlike_end": 0.96,
            "moment apart": 0.43,
            "now unlike_end": 0.38,
            "moment unlike_end": 0.21,
        },
    ),
    "ForeArm": (
        -8.07,
        {
            "while beside_other": 12.14,
            "now end_in_trunk": 9.73,
            "now beside_other": 8.45,
            "while contested": 3.56,
            "while jerking_lower": 2.92,
            "now crossed": 2.38,
            "now jerking_lower": 1.76,
            "while unlike_lower": 1.71,
            "moment unlike_lower": 1.65,
            "now handless": 1.50,
            "now unlike_lower": 1.24,
            "while unlike_end": 1.11,
            "moment handless": 0.89,
            "moment unlike_end": 0.20,
            "now apart": 0.12,
        },
    ),
    "LowerLeg": (
        -10.82,
        {
            "now exchangeable": 6.24,
            "moment outside": 4.07,
            "while jerking_lower": 3.48,
            "now jerking_lower": 2.42,
            "moment crossed": 1.93,
            "now few_at_end": 1.65,
            "now crossed": 1.53,
            "now far": 1.48,
            "moment far": 1.36,
            "now outside": 1.19,
            "now odd_foot": 1.03,
            "now foot_back": 0.80,
            "moment odd_foot": 0.57,
            "moment unlike_end": 0.52,
            "while foot_back": 0.31,
            "now unlike_end": 0.17,
            "moment apart": 0.00,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
4940 frames of 38 captures that were made for it, 356 of them wrong.
"""
