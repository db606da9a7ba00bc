"""Any bytes at all: a motion or an `InputError`, never a crash, a hang or a warning."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.motion.c3d import write_c3d
from storage.formats.motion.trc import write_trc
from tests.conftest import cases
from tests.figures.strategies import damaged
from tests.storage.formats.motion.test_bvh import WHOLE as BVH
from tests.storage.formats.motion.test_trc import WHOLE as TRC

SUFFIXES = (".c3d", ".trc", ".bvh")
many = settings(max_examples=cases(100))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("bytes")


def read_or_refuse(path, data):
    """The motion, checked for what every motion must be, or None where it was refused."""
    path.write_bytes(data)
    try:
        motion = read_motion_file(path)
    except InputError as error:
        said = str(error)
    else:
        check_motion(motion, len(data))
        return motion
    assert str(path) in said
    assert len(said) < 1000
    assert "\n" not in said
    return None


def check_motion(motion, size):
    """Assert what every motion must be."""
    frames, markers, _ = motion.position.shape
    assert frames > 0
    assert 0 < markers == len(motion.names) == len(set(motion.names))
    assert 0 < motion.rate_hz < np.inf
    assert not np.isinf(motion.position).any()
    gaps = np.isnan(motion.position)
    assert (gaps.any(axis=-1) == gaps.all(axis=-1)).all()
    assert frames * markers * 24 <= 100 * size + 2**26


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.drawn
@many
@given(data=st.binary(max_size=3000))
def test_any_bytes(folder, suffix, data):
    assert read_or_refuse(folder / f"any{suffix}", data) is None


@pytest.mark.drawn
@many
@given(head=st.binary(min_size=512, max_size=512), rest=st.binary(max_size=4000))
def test_any_bytes_behind_the_mark_of_a_c3d(folder, head, rest):
    read_or_refuse(folder / "mark.c3d", b"\x02\x50" + head[2:] + b"\x01\x50\x04\x54" + rest)


def written_c3d(folder):
    position = np.random.default_rng(3).normal(0, 1, (9, 5, 3))
    position[4, 2] = np.nan
    write_c3d(folder / "whole.c3d", position, ["RHip", "LHip", "Neck", "Waist", "Head"], 60.0)
    return (folder / "whole.c3d").read_bytes()


def written_trc(folder):
    position = np.random.default_rng(4).normal(0, 1, (9, 5, 3))
    position[4, 2] = np.nan
    write_trc(folder / "whole.trc", position, ["RHip", "LHip", "Neck", "Waist", "Head"], 60.0)
    return (folder / "whole.trc").read_bytes()


@pytest.mark.parametrize(
    ("suffix", "whole", "head"),
    [(".c3d", written_c3d, 1024), (".trc", written_trc, 500),
     (".trc", lambda _: TRC.encode(), 150), (".bvh", lambda _: BVH.encode(), 600)],
    ids=["c3d", "trc", "small trc", "bvh"],
)  # fmt: skip
@pytest.mark.drawn
@settings(max_examples=cases(75))
@given(data=st.data())
def test_a_damaged_file(folder, suffix, whole, head, data):
    read_or_refuse(folder / f"bad{suffix}", data.draw(damaged(whole(folder), head=head)))


@pytest.mark.parametrize(
    ("suffix", "whole"),
    [(".c3d", written_c3d), (".trc", written_trc), (".bvh", lambda _: BVH.encode())],
    ids=["c3d", "trc", "bvh"],
)
def test_a_file_cut_anywhere_is_refused_or_has_lost_nothing(folder, suffix, whole):
    data = whole(folder)
    first = read_or_refuse(folder / f"cut{suffix}", data)
    assert first is not None
    survived = 0
    for length in range(len(data)):
        motion = read_or_refuse(folder / f"cut{suffix}", data[:length])
        if motion is None:
            continue
        survived += 1
        # Nothing tells a last number cut in two from a shorter one; that is noted.
        rest = motion.position[:-1] if motion.notes else motion.position
        np.testing.assert_array_equal(rest, first.position[: len(rest)])
        assert motion.position.shape == first.position.shape
        assert not motion.notes or "last number may be cut" in motion.notes[0]
    assert survived < 12


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "head"),
    [("c3d/Eb015pi.c3d", 5120), ("c3d/pc_real.c3d", 6144), ("c3d/badParameterOffset.c3d", 4608),
     ("c3d/walkingOptiTrack.c3d", 1536), ("trc/T_pose.trc", 3000)],
)  # fmt: skip
@pytest.mark.drawn
@settings(max_examples=cases(30))
@given(data=st.data())
def test_a_damaged_recording(folder, shared_data, name, head, data):
    path = shared_data / name
    spoiled = data.draw(damaged(path.read_bytes(), head=head))
    read_or_refuse(folder / f"recording{path.suffix}", spoiled)


@pytest.mark.data
@pytest.mark.drawn
def test_a_damaged_head_of_a_c3d_never_moves_the_markers(folder, shared_data):
    rng = np.random.default_rng(8)
    whole = (shared_data / "c3d" / "pc_real.c3d").read_bytes()
    first = read_or_refuse(folder / "head.c3d", whole)
    outcomes = set()
    for _ in range(cases(200)):
        spoiled = bytearray(whole)
        spoiled[rng.integers(0, 6144)] ^= 1 << rng.integers(0, 8)
        motion = read_or_refuse(folder / "head.c3d", bytes(spoiled))
        if motion is None:
            outcomes.add("refused")
        elif motion.position.shape == first.position.shape:
            np.testing.assert_array_equal(motion.position, first.position)
            outcomes.add("same")
        else:
            kept = [n for n, name in enumerate(first.names) if name in motion.names]
            assert len(kept) >= len(motion.names) - 1
            assert motion.notes
            outcomes.add("fewer markers")
    assert {"refused", "same"} <= outcomes
