"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.42,
        {},
    ),
    "UpperArm": (
        -7.89,
        {
            "moment in_trunk": 5.65,
            "while moving": 4.07,
            "while strange_lower": 3.14,
            "while in_trunk": 3.02,
            "moment without_end": 2.20,
            "moment moving": 2.07,
            "moment outside": 1.64,
            "moment strange_lower": 0.99,
            "while apart": 0.62,
            "moment apart": 0.36,
        },
    ),
    "UpperLeg": (
        -5.84,
        {
            "moment crossed": 3.05,
            "while without_end": 3.00,
            "moment exchangeable": 2.07,
            "while foot_back": 1.66,
            "while odd_foot": 1.65,
            "moment far": 1.33,
            "moment odd_foot": 1.23,
            "while crossed": 0.93,
            "while few_at_end": 0.86,
            "moment foot_back": 0.73,
            "moment without_end": 0.61,
            "moment strange_end": 0.55,
            "moment apart": 0.48,
            "while apart": 0.19,
        },
    ),
    "ForeArm": (
        -7.08,
        {
            "moment in_trunk": 5.38,
            "while moving": 5.37,
            "while strange_lower": 3.32,
            "while hardly_told": 3.12,
            "moment handless": 2.59,
            "moment without_end": 1.97,
            "moment moving": 1.16,
            "moment strange_lower": 0.89,
            "while apart": 0.64,
            "moment jerking": 0.55,
        },
    ),
    "LowerLeg": (
        -4.36,
        {
            "while few_at_end": 4.37,
            "while foot_back": 2.29,
            "moment crossed": 2.27,
            "while odd_foot": 1.65,
            "moment odd_foot": 1.01,
            "moment apart": 0.74,
            "moment far": 0.71,
            "while without_end": 0.70,
            "while apart": 0.54,
            "moment few_at_end": 0.51,
            "moment strange_end": 0.44,
            "moment together": 0.42,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
3900 frames of 30 captures that were made for it, 484 of them wrong.
"""
