"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -8.96,
        {},
    ),
    "UpperArm": (
        -5.60,
        {
            "moment in_trunk": 4.00,
            "while moving": 2.40,
            "while jerking": 1.47,
            "while strange_lower": 1.45,
            "moment handless": 1.22,
            "while apart": 1.17,
            "moment strange_lower": 0.58,
            "moment apart": 0.16,
        },
    ),
    "UpperLeg": (
        -8.33,
        {
            "moment crossed": 4.69,
            "while odd_foot": 3.92,
            "while few_at_end": 2.88,
            "while beside_end": 2.84,
            "moment exchangeable": 2.75,
            "moment without_end": 2.54,
            "while without_end": 2.29,
            "while crossed": 1.67,
            "moment far": 1.55,
            "while exchangeable": 1.53,
            "while foot_back": 1.27,
            "moment beside_end": 0.93,
            "moment strange_lower": 0.86,
            "moment apart": 0.81,
            "while far": 0.45,
            "while foot_aside": 0.35,
        },
    ),
    "ForeArm": (
        -7.15,
        {
            "moment in_trunk": 7.17,
            "moment hardly_told": 5.60,
            "while jerking": 3.44,
            "while strange_lower": 1.57,
            "while hardly_told": 1.56,
            "moment together": 1.44,
            "while together": 0.81,
            "moment apart": 0.71,
            "moment handless": 0.67,
            "while apart": 0.59,
            "moment end_turned": 0.51,
            "while bent": 0.44,
        },
    ),
    "LowerLeg": (
        -8.77,
        {
            "while few_at_end": 4.04,
            "while exchangeable": 3.40,
            "moment beside_end": 3.29,
            "moment crossed": 3.00,
            "moment odd_foot": 2.97,
            "while crossed": 2.82,
            "while without_end": 2.75,
            "while odd_foot": 2.38,
            "while apart": 1.94,
            "while beside_end": 1.92,
            "moment few_at_end": 1.89,
            "while without_upper": 1.82,
            "moment without_end": 1.23,
            "moment far": 1.08,
            "moment strange_lower": 1.06,
            "while foot_back": 0.93,
            "moment foot_aside": 0.71,
            "while foot_aside": 0.55,
            "moment apart": 0.30,
            "moment foot_back": 0.24,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
2600 frames of 20 captures that were made for it, 470 of them wrong.
"""
