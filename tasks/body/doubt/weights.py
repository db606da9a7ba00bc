"""How much each evidence speaks against a segment.

Written by `python -m tests.benchmarks.bodies.doubt --learn`, not by hand.
"""

WEIGHTS: dict[str, tuple[float, dict[str, float]]] = {
    "trunk": (
        -8.27,
        {},
    ),
    "UpperArm": (
        -7.33,
        {
            "now beside_other": 11.22,
            "while end_in_trunk": 7.96,
            "while jerking_lower": 7.03,
            "moment end_in_trunk": 6.71,
            "now crossed": 4.57,
            "moment crossed": 3.02,
            "now end_in_trunk": 2.85,
            "moment contested": 2.76,
            "moment unlike_end": 1.40,
            "moment jerking_lower": 1.19,
            "while unlike_lower": 0.74,
        },
    ),
    "UpperLeg": (
        -10.11,
        {
            "while jerking_lower": 3.38,
            "moment outside": 3.07,
            "now crossed": 2.62,
            "now far": 1.91,
            "moment crossed": 1.62,
            "moment odd_foot": 1.53,
            "now jerking_lower": 1.39,
            "now outside": 1.28,
            "moment far": 1.27,
            "while unlike_end": 0.89,
            "while foot_back": 0.83,
            "moment unlike_end": 0.65,
            "moment foot_back": 0.65,
        },
    ),
    "ForeArm": (
        -7.94,
        {
            "moment end_in_trunk": 10.05,
            "now beside_other": 9.00,
            "now end_in_trunk": 6.47,
            "while jerking_lower": 5.25,
            "moment beside_other": 3.26,
            "now crossed": 3.11,
            "while contested": 2.40,
            "while unlike_end": 2.29,
            "now handless": 2.13,
            "now unlike_lower": 1.66,
            "moment crossed": 1.12,
            "now jerking_lower": 0.82,
            "moment unlike_lower": 0.81,
            "moment unlike_end": 0.69,
            "moment contested": 0.52,
        },
    ),
    "LowerLeg": (
        -7.66,
        {
            "while beside_other": 4.10,
            "while jerking_lower": 3.44,
            "moment outside": 2.22,
            "moment few_at_end": 1.92,
            "moment odd_foot": 1.30,
            "while foot_back": 1.21,
            "now crossed": 1.18,
            "now far": 1.16,
            "while crossed": 1.15,
            "moment crossed": 0.78,
            "moment beside_other": 0.73,
            "moment far": 0.65,
            "moment foot_back": 0.57,
            "now outside": 0.51,
            "moment apart": 0.38,
            "now foot_back": 0.20,
            "while far": 0.19,
            "now unlike_end": 0.07,
        },
    ),
}
"""By the kind of segment: the logarithm of the odds where nothing speaks against it, and
what each evidence adds to it, times its size. The names are those of
`tasks.body.doubt.evidence`, after the window that they are averaged over. Learned from
5200 frames of 40 captures that were made for it, 420 of them wrong.
"""
