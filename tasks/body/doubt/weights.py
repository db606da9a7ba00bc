"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.03,
        {},
    ),
    "UpperArm": (
        -9.25,
        {
            "moment in_trunk": 8.71,
            "while moving": 8.69,
            "while in_trunk": 3.51,
            "while strange_lower": 3.08,
            "moment handless": 1.90,
            "moment outside": 1.79,
            "moment apart": 0.88,
            "moment strange_lower": 0.47,
        },
    ),
    "UpperLeg": (
        -8.46,
        {
            "while without_end": 4.80,
            "while odd_foot": 4.00,
            "while beside_end": 3.83,
            "moment crossed": 2.77,
            "moment exchangeable": 2.14,
            "moment odd_foot": 1.84,
            "moment without_end": 1.69,
            "while crossed": 1.67,
            "moment far": 1.11,
            "while few_at_end": 1.07,
            "moment apart": 1.03,
            "while foot_back": 0.96,
            "moment few_at_end": 0.83,
            "while exchangeable": 0.81,
            "moment foot_back": 0.55,
            "while foot_aside": 0.26,
            "moment strange_end": 0.24,
        },
    ),
    "ForeArm": (
        -6.97,
        {
            "moment in_trunk": 7.89,
            "moment hardly_told": 6.91,
            "while moving": 4.34,
            "while together": 2.09,
            "moment handless": 1.70,
            "while strange_lower": 1.15,
            "moment together": 1.07,
            "while hardly_told": 0.89,
            "moment jerking": 0.75,
            "moment apart": 0.63,
            "moment end_turned": 0.61,
        },
    ),
    "LowerLeg": (
        -6.61,
        {
            "while odd_foot": 4.57,
            "while few_at_end": 4.20,
            "moment crossed": 3.89,
            "while exchangeable": 3.51,
            "while without_end": 2.55,
            "moment without_end": 1.66,
            "moment odd_foot": 1.39,
            "moment few_at_end": 1.19,
            "moment apart": 1.18,
            "moment far": 1.16,
            "while foot_back": 0.99,
            "while crossed": 0.94,
            "while apart": 0.89,
            "moment foot_back": 0.79,
            "while foot_aside": 0.74,
            "moment strange_end": 0.15,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
3380 frames of 26 captures that were made for it, 480 of them wrong.
"""
