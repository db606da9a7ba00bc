"""What a frame's voxels say of a pose, against the same sums in whole arrays."""

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES
from tasks.body.doubt.voxels import AROUND, BESIDE, FAR, OWN, report_voxels

STATURE_M = 1.4


@pytest.fixture
def body():
    """Voxels around bones, with colors of which some are likely on some bones."""
    rng = np.random.default_rng(5)
    begin, end = rng.uniform(-0.6, 0.6, (2, len(BONES), 3))
    points = rng.uniform(-0.8, 0.8, (700, 3))
    cell = rng.integers(-1, 6, 700)
    looks = rng.normal(0.0, 1.0, (7, len(BONES))).astype(np.float32)
    inside = rng.uniform(-1.0, 1.0, (4, 3))
    return points, cell, looks, (begin, end), (begin + end) / 2, inside


def test_the_sums_are_those_of_whole_arrays(body):
    points, cell, looks, (begin, end), middle, inside = body
    line = end - begin
    share = np.einsum("nka,ka->nk", points[:, None] - begin, line) / (line**2).sum(axis=1)
    on_line = begin + np.clip(share, 0, 1)[..., None] * line
    away = np.linalg.norm(points[:, None] - on_line, axis=2) / STATURE_M
    nearest, least = away.argmin(axis=1), away.min(axis=1)
    around = np.linalg.norm(points[:, None] - middle, axis=2) / STATURE_M < AROUND
    colored = (cell[:, None] >= 0) & (looks[cell] > 0.5) & around
    found = report_voxels(*body, stature_m=STATURE_M)
    for k in range(len(BONES)):
        own = (nearest == k) & (least < OWN)
        known = own & (cell >= 0)
        assert found.own[k] == own.sum()
        expected = -looks[cell[known], k].mean() if known.any() else 0.0
        assert found.strangeness[k] == pytest.approx(expected, abs=1e-5)
        assert found.far[k] == pytest.approx(((nearest == k) & (least > FAR)).mean())
        beside = (colored[:, k] & (away[:, k] > BESIDE)).sum()
        assert found.beside[k] == pytest.approx(beside / (colored[:, k].sum() + 3))
    apart = np.linalg.norm(inside[:, None] - points, axis=2).min(axis=1)
    np.testing.assert_allclose(found.outside, apart)
    np.testing.assert_array_equal(found.bone, np.where(least < OWN, nearest, -1))
    assert (found.own > 0).all()
    assert found.far.sum() > 0.1
    assert found.beside.max() > 0.2


def test_an_unknown_color_says_nothing(body):
    points, cell, *rest = body
    found = report_voxels(points, np.full_like(cell, -1), *rest, stature_m=STATURE_M)
    assert not found.strangeness.any()
    assert not found.beside.any()
    np.testing.assert_array_equal(found.own, report_voxels(*body, stature_m=STATURE_M).own)


def test_voxels_in_cloth_between_limbs_are_not_far(body):
    points, cell, looks, (begin, end), *rest = body
    bones = report_voxels(*body, stature_m=STATURE_M)
    across = np.array([[-0.7, 0.7, 0.7]]), np.array([[0.7, 0.7, 0.7]])
    lines = np.concatenate([begin, across[0]]), np.concatenate([end, across[1]])
    found = report_voxels(points, cell, looks, lines, *rest, stature_m=STATURE_M)
    assert found.far.sum() < bones.far.sum() - 0.01
    assert (found.far <= bones.far).all()
    np.testing.assert_array_equal(found.own, bones.own)
    nowhere = np.concatenate([begin, begin[:1] + 9.0]), np.concatenate([end, end[:1] + 9.0])
    np.testing.assert_array_equal(
        report_voxels(points, cell, looks, nowhere, *rest, stature_m=STATURE_M).far, bones.far
    )
