"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.17,
        {},
    ),
    "UpperArm": (
        -10.53,
        {
            "moment in_trunk": 11.30,
            "moment few_lower": 3.94,
            "while unlike_end": 3.62,
            "while jerking": 3.19,
            "while moving": 3.06,
            "while strange_lower": 2.40,
            "while apart": 2.02,
            "moment unlike_end": 1.31,
            "moment outside": 0.99,
            "moment apart": 0.92,
            "moment jerking": 0.56,
        },
    ),
    "UpperLeg": (
        -5.63,
        {
            "while few_at_end": 3.12,
            "moment crossed": 2.99,
            "while crossed": 1.87,
            "while odd_foot": 1.63,
            "moment without_end": 1.55,
            "moment exchangeable": 1.50,
            "moment odd_foot": 1.47,
            "while exchangeable": 1.30,
            "moment far": 1.25,
            "moment few_at_end": 1.11,
            "while foot_back": 1.05,
            "moment apart": 0.97,
            "while without_end": 0.87,
            "moment foot_back": 0.83,
            "while apart": 0.66,
            "while strange_end": 0.39,
            "moment strange_end": 0.39,
        },
    ),
    "ForeArm": (
        -8.92,
        {
            "while few_lower": 10.75,
            "moment in_trunk": 6.86,
            "while moving": 5.57,
            "while unlike_end": 2.50,
            "moment handless": 2.27,
            "while strange_lower": 2.00,
            "while together": 1.87,
            "while hardly_told": 1.49,
            "moment jerking": 1.37,
            "while exchangeable": 1.36,
            "moment unlike_lower": 0.72,
            "moment few_lower": 0.59,
            "while apart": 0.59,
            "moment without_end": 0.57,
            "moment strange_lower": 0.56,
            "moment unlike_end": 0.39,
        },
    ),
    "LowerLeg": (
        -5.89,
        {
            "moment crossed": 2.96,
            "while few_at_end": 2.88,
            "while odd_foot": 2.54,
            "while crossed": 2.04,
            "moment without_end": 2.01,
            "moment apart": 1.80,
            "moment exchangeable": 1.53,
            "moment odd_foot": 1.37,
            "while exchangeable": 1.27,
            "moment far": 1.22,
            "while without_end": 1.22,
            "moment foot_back": 1.21,
            "moment few_at_end": 0.95,
            "while foot_back": 0.86,
            "moment strange_end": 0.69,
            "while unlike_end": 0.23,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
3900 frames of 30 captures that were made for it, 345 of them wrong.
"""
