"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.48,
        {},
    ),
    "UpperArm": (
        -6.57,
        {
            "moment beside_other": 10.57,
            "while jerking_lower": 4.31,
            "moment end_in_trunk": 4.10,
            "moment jerking_lower": 2.97,
            "moment crossed": 2.33,
            "moment unlike_end": 1.35,
            "while contested": 1.33,
            "moment in_trunk": 0.37,
        },
    ),
    "UpperLeg": (
        -7.20,
        {
            "moment crossed": 4.61,
            "moment jerking_lower": 3.90,
            "moment odd_foot": 3.28,
            "moment exchangeable": 3.20,
            "while foot_back": 2.70,
            "while crossed": 2.48,
            "while off_sight": 2.04,
            "moment far": 1.49,
            "while few_at_end": 1.42,
            "moment few_at_end": 1.00,
            "while far": 0.82,
            "moment outside": 0.70,
            "while jerking_lower": 0.49,
        },
    ),
    "ForeArm": (
        -7.14,
        {
            "moment end_in_trunk": 14.59,
            "moment beside_other": 12.75,
            "moment crossed": 3.97,
            "moment jerking_lower": 3.66,
            "while contested": 2.03,
            "moment handless": 2.03,
            "while unlike_end": 1.62,
            "while jerking_lower": 1.26,
            "moment unlike_end": 1.17,
        },
    ),
    "LowerLeg": (
        -6.17,
        {
            "while beside_other": 3.13,
            "while few_at_end": 2.80,
            "moment jerking_lower": 2.49,
            "moment crossed": 2.42,
            "while crossed": 2.40,
            "moment odd_foot": 1.70,
            "while off_sight": 1.54,
            "while jerking_lower": 1.50,
            "while foot_back": 1.30,
            "moment beside_other": 1.23,
            "moment far": 1.14,
            "moment unlike_end": 1.02,
            "moment foot_back": 0.69,
            "moment outside": 0.65,
            "while far": 0.42,
            "moment few_at_end": 0.37,
            "moment contested": 0.31,
            "moment apart": 0.21,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
5330 frames of 41 captures that were made for it, 597 of them wrong.
"""
