"""A raised foot is found by the colors of the one that stands, and by nothing less."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.body.initial.joints import _with_raised
from tasks.body.initial.raised import find_raised_foot

VOXEL_M, STATURE_M = 0.01, 1.6
SOCK, SKIRT = (235, 230, 228), (120, 30, 130)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def box(low, high):
    """Return the centers of voxels between two corners, m."""
    axes = [np.arange(a, b, VOXEL_M) + VOXEL_M / 2 for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


STANDS = box((-0.15, 0.0, -0.05), (-0.08, 0.06, 0.2))
RAISED = box((0.06, 0.25, -0.3), (0.13, 0.31, -0.08))
ROBE = box((-0.2, 0.06, -0.08), (0.2, 1.2, 0.1))


def seen(rng, *pieces):
    """Return the voxels of pieces and their surface, in noisy colors; the first is the foot."""
    color = [np.tile(c, (len(p), 1)) + rng.integers(-6, 7, (len(p), 3)) for p, c in pieces]
    point = np.concatenate([p for p, _ in pieces])
    return point, (point, np.concatenate(color).astype(np.uint8))


def find(point, colored):
    return find_raised_foot(point, STANDS, colored, STATURE_M, VOXEL_M)


def test_a_foot_off_the_floor_is_found_by_its_color(rng):
    found = find(*seen(rng, (STANDS, SOCK), (RAISED, SOCK), (ROBE, SKIRT)))
    own = (np.abs(found - RAISED.mean(axis=0)) < [0.07, 0.06, 0.14]).all(axis=1)
    assert own.all()
    assert len(found) >= len(RAISED)


def test_a_foot_on_tiptoe_is_found_whose_toes_are_as_low_as_the_one_that_stands(rng):
    tiptoe = RAISED - [0.0, 0.22, 0.0]
    toes = tiptoe[tiptoe[:, 1] < 0.06]
    point, colored = seen(rng, (STANDS, SOCK), (tiptoe, SOCK), (ROBE, SKIRT))
    body = SimpleNamespace(left=np.array([1.0, 0.0, 0.0]), stature_m=STATURE_M)
    low = np.concatenate([toes, STANDS])
    right, left = _with_raised(low, point, colored, body, body, VOXEL_M)
    np.testing.assert_array_equal(right, STANDS)
    assert (left[:, 0] > 0.0).all()
    assert len(left) >= len(tiptoe)
    [alone] = _with_raised(low, ROBE, (STANDS, colored[1][: len(STANDS)]), body, body, VOXEL_M)
    np.testing.assert_array_equal(alone, low)


@pytest.mark.parametrize(
    "others",
    [
        [(RAISED, SKIRT)],
        [(RAISED[: len(RAISED) // 4], SOCK)],
        [(RAISED, SOCK), (RAISED - [0.3, 0.0, 0.0], SOCK)],
        [(RAISED - [0.0, -0.6, 0.0], SOCK)],
    ],
    ids=["another color", "a patch", "two alike", "a hand's height"],
)
def test_what_may_be_no_foot_is_none(rng, others):
    assert find(*seen(rng, (STANDS, SOCK), *others, (ROBE, SKIRT))) is None


def test_bare_legs_tell_no_foot(rng):
    """Where all that is low has the colors of the foot nothing is told."""
    assert find(*seen(rng, (STANDS, SOCK), (RAISED, SOCK), (ROBE, SOCK))) is None


def test_a_foot_alone_has_no_other(rng):
    assert find(*seen(rng, (STANDS, SOCK))) is None
