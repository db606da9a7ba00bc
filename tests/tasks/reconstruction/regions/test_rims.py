"""How far a mask ends before the performer does, against figures drawn at a known place."""

import cv2
import numpy as np
import pytest

from tasks.reconstruction.regions.masks import silhouettes_of
from tasks.reconstruction.regions.rims import DISTANCES, edge_profile, shrinking, too_narrow_px

SQUARE = np.ones((3, 3), np.uint8)


def filmed(rows, offset=0.0, noise=4.0):
    """A body of limbs before a wall with folds, as a camera of so many rows sees it, and where."""
    scale = rows / 240
    fine = 4  # drawn larger, so that rims are as soft as a camera's
    size = (round(320 * scale) * fine, rows * fine)
    inside = np.zeros(size[::-1], np.uint8)
    for a, b in (((160, 60), (150, 150)), ((150, 150), (120, 220)), ((160, 70), (230, 120))):
        ends = [tuple(round(fine * scale * (each + offset)) for each in point) for point in (a, b)]
        cv2.line(inside, *ends, 1, round(20 * scale * fine))
    x = np.arange(size[0]) / (fine * scale)
    wall = (110 + 25 * np.sin(x / 9))[None, :, None] * np.array([1.0, 0.9, 0.8])
    picture = np.where(inside[..., None] > 0, np.array([170.0, 60, 40]), wall)
    small = cv2.resize(picture, None, fx=1 / fine, fy=1 / fine, interpolation=cv2.INTER_AREA)
    share = cv2.resize(255 * inside, None, fx=1 / fine, fy=1 / fine, interpolation=cv2.INTER_AREA)
    noisy = small + np.random.default_rng(1).normal(0, noise, small.shape)
    return noisy.clip(0, 255).astype(np.uint8), share


@pytest.mark.parametrize("rows", [240, 720])
@pytest.mark.parametrize("by", [-1, 0, 1, 2])
def test_what_is_missing_at_the_rim_is_measured(rows, by):
    picture, mask = filmed(rows)
    times = abs(by) * shrinking(rows)
    change = cv2.dilate if by < 0 else cv2.erode
    changed = change(mask, SQUARE, iterations=times) if times else mask
    found = too_narrow_px(edge_profile(picture, changed >= 128)[None])
    assert found == pytest.approx(by, abs=0.35)  # a square takes more off what is aslant


def test_no_edge_is_told_where_a_mask_is_of_another_moment():
    picture, _ = filmed(240)
    _, mask = filmed(240, offset=50.0)
    assert np.isnan(too_narrow_px(edge_profile(picture, mask >= 128)[None]))


@pytest.mark.parametrize("value", [0, 255])
def test_a_mask_without_a_rim_tells_nothing(value):
    picture, mask = filmed(240)
    profile = edge_profile(picture, np.full_like(mask, value) >= 128)
    assert not profile.any()
    assert profile.shape == (len(DISTANCES) + 1,)
    assert np.isnan(too_narrow_px(profile[None]))


@pytest.mark.parametrize("by", [1, 3])
def test_masks_that_are_grown_and_shrunk_are_as_they_were(by):
    _, mask = filmed(240)
    body = silhouettes_of(mask[None])
    for thinner, way in ((cv2.erode, by), (cv2.dilate, -by)):
        other = thinner(mask, SQUARE, iterations=by)
        again = silhouettes_of(other[None], way)
        assert (again != body).sum() < 0.3 * ((other >= 128)[None] != body).sum()
    assert not silhouettes_of(np.zeros_like(mask)[None], 2.0).any()
    assert silhouettes_of(np.full_like(mask, 255)[None], -2.0).all()
