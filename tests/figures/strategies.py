"""Hypothesis strategies: joint tracks with gaps, and files that lost or changed some bytes."""

import numpy as np
from hypothesis import strategies as st


@st.composite
def tracks(draw, *, far_m: float = 20.0):
    """(position, names, rate_hz) of a few joints: metres, NaN in all three where missing."""
    frames, joints = draw(st.integers(1, 40)), draw(st.integers(1, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    position = rng.uniform(-far_m, far_m, (frames, joints, 3))
    position[rng.random((frames, joints)) < draw(st.sampled_from([0.0, 0.2, 0.9]))] = np.nan
    names = draw(
        st.lists(
            st.text("ABCxyz_0129éö所作", min_size=1, max_size=9),
            min_size=joints,
            max_size=joints,
            unique=True,
        )
    )
    return position, names, draw(st.sampled_from([24.0, 29.97, 30.0, 119.88, 120.0, 240.0]))


@st.composite
def damaged(draw, whole: bytes, *, head: int):
    """The bytes of a file cut, changed, shortened or lengthened, mostly in its head."""
    data = bytearray(whole)
    end = draw(st.sampled_from([min(head, len(data)), len(data)]))
    at = st.integers(0, end - 1)
    match draw(st.sampled_from(["cut", "change", "change", "delete", "insert"])):
        case "cut":
            del data[draw(st.integers(0, len(data) - 1)) :]
        case "change":
            for place in draw(st.lists(at, min_size=1, max_size=8)):
                data[place] = draw(st.sampled_from([0, 9, 45, 48, 57, 127, 128, 255]))
        case "delete":
            place = draw(at)
            del data[place : place + draw(st.integers(1, 600))]
        case "insert":
            place = draw(at)
            data[place:place] = draw(st.binary(min_size=1, max_size=40))
    return bytes(data)
