"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.99,
        {},
    ),
    "UpperArm": (
        -6.78,
        {
            "now beside_other": 7.65,
            "while jerking_lower": 4.90,
            "while end_in_trunk": 3.79,
            "moment end_in_trunk": 3.32,
            "while contested": 3.01,
            "now crossed": 2.69,
            "while unlike_lower": 2.10,
            "now in_trunk": 1.94,
            "now jerking_lower": 1.48,
            "moment unlike_end": 1.40,
            "moment crossed": 0.66,
        },
    ),
    "UpperLeg": (
        -11.37,
        {
            "while jerking_lower": 4.48,
            "now few_at_end": 4.37,
            "now jerking_lower": 4.11,
            "now crossed": 2.62,
            "moment far": 2.46,
            "moment crossed": 2.24,
            "now far": 1.94,
            "now foot_back": 1.81,
            "moment apart": 0.37,
            "now apart": 0.26,
        },
    ),
    "ForeArm": (
        -7.17,
        {
            "now beside_other": 8.73,
            "moment end_in_trunk": 7.48,
            "now end_in_trunk": 6.97,
            "while jerking_lower": 3.23,
            "while contested": 2.88,
            "now crossed": 2.67,
            "while unlike_end": 2.56,
            "now in_trunk": 2.11,
            "now handless": 1.96,
            "now jerking_lower": 1.31,
            "now unlike_lower": 1.16,
            "while unlike_lower": 1.06,
            "moment crossed": 0.88,
        },
    ),
    "LowerLeg": (
        -6.50,
        {
            "while beside_other": 2.86,
            "while jerking_lower": 2.48,
            "moment contested": 1.83,
            "moment outside": 1.41,
            "moment beside_other": 0.93,
            "now few_at_end": 0.81,
            "moment few_at_end": 0.73,
            "while crossed": 0.65,
            "now foot_back": 0.62,
            "now odd_foot": 0.60,
            "moment crossed": 0.54,
            "now far": 0.45,
            "moment far": 0.41,
            "while far": 0.41,
            "now crossed": 0.33,
            "now apart": 0.33,
            "while foot_back": 0.30,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
4940 frames of 38 captures that were made for it, 363 of them wrong.
"""
