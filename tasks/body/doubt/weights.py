"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -7.14,
        {},
    ),
    "UpperArm": (
        -10.34,
        {
            "moment in_trunk": 11.03,
            "moment few_lower": 3.78,
            "while unlike_end": 3.69,
            "while jerking": 3.00,
            "while moving": 2.92,
            "while strange_lower": 2.27,
            "while apart": 1.98,
            "moment unlike_end": 1.23,
            "moment outside": 0.96,
            "moment apart": 0.90,
            "moment jerking": 0.57,
        },
    ),
    "UpperLeg": (
        -5.24,
        {
            "while few_at_end": 2.89,
            "moment crossed": 2.79,
            "while crossed": 1.75,
            "while odd_foot": 1.48,
            "moment without_end": 1.46,
            "moment exchangeable": 1.43,
            "moment odd_foot": 1.31,
            "while exchangeable": 1.18,
            "moment far": 1.15,
            "moment few_at_end": 1.10,
            "while foot_back": 0.96,
            "moment apart": 0.91,
            "moment foot_back": 0.78,
            "while without_end": 0.66,
            "while apart": 0.60,
            "while strange_end": 0.51,
            "moment strange_end": 0.32,
        },
    ),
    "ForeArm": (
        -9.42,
        {
            "while few_lower": 12.14,
            "moment in_trunk": 7.40,
            "while moving": 5.77,
            "while unlike_end": 2.95,
            "moment handless": 2.29,
            "while strange_lower": 2.06,
            "while together": 2.04,
            "while hardly_told": 1.54,
            "while exchangeable": 1.49,
            "moment jerking": 1.49,
            "moment unlike_lower": 0.79,
            "moment without_end": 0.68,
            "while apart": 0.66,
            "moment strange_lower": 0.65,
            "moment unlike_end": 0.34,
        },
    ),
    "LowerLeg": (
        -5.57,
        {
            "moment crossed": 2.78,
            "while few_at_end": 2.67,
            "while odd_foot": 2.22,
            "moment without_end": 1.92,
            "while crossed": 1.92,
            "moment apart": 1.67,
            "moment exchangeable": 1.48,
            "moment odd_foot": 1.29,
            "while exchangeable": 1.14,
            "moment foot_back": 1.12,
            "moment far": 1.12,
            "while without_end": 1.04,
            "moment few_at_end": 0.96,
            "while foot_back": 0.76,
            "moment strange_end": 0.54,
            "while unlike_end": 0.50,
            "while strange_end": 0.20,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
3770 frames of 29 captures that were made for it, 345 of them wrong.
"""
