"""Outlines of the background alone, against each pixel looked at by itself."""

import cv2
import numpy as np
import pytest

from tasks.reconstruction.regions.stale_outlines import stale_outline


def around(row, column, shape, far=1):
    """Yield the pixels of a picture that lie around one, and itself."""
    for i in range(max(0, row - far), min(shape[0], row + far + 1)):
        for j in range(max(0, column - far), min(shape[1], column + far + 1)):
            yield i, j


def change(picture, row, column):
    """Return how much the channel that changes most does so around a pixel."""
    seen = np.array([picture[each] for each in around(row, column, picture.shape)], float)
    return np.ptp(seen, axis=0).max()


def smoothed(frame):
    """Return a frame smoothed by 1-2-1, as OpenCV does it."""
    return cv2.GaussianBlur(frame, (3, 3), 0)


def slowly(silhouette, frame, color):
    """The rule as the docstrings give it, a pixel at a time."""
    found = np.zeros_like(silhouette)
    frame = smoothed(frame)
    for row, column in np.argwhere(silhouette):
        if all(silhouette[each] for each in around(row, column, silhouette.shape)):
            continue
        behind = change(color, row, column)
        ahead = max(change(frame, *each) for each in around(row, column, silhouette.shape))
        found[row, column] = behind >= 24 and ahead <= behind / 2
    return found


@pytest.mark.parametrize("beside", [0, 6], ids=["at the border", "inside"])
def test_each_pixel_is_told_as_by_itself(beside):
    stale = sum(check_one(np.random.default_rng(seed), beside) for seed in range(20))
    assert stale > 20


def check_one(rng, beside):
    """Compare a picture, whose silhouette is so far inside; return how many pixels are stale."""
    size = rng.integers(4, 16, 2) + 2 * beside
    spots = rng.random((2, *size, 3)) < 0.03  # few, so that each tells by itself
    frame, color = np.uint8(90) * spots[0], np.float32(30) * spots[1]
    silhouette = cv2.GaussianBlur(rng.random(size), (0, 0), 1.5) > 0.5
    inside = np.zeros(size, bool)
    inside[beside : size[0] - beside, beside : size[1] - beside] = True
    silhouette &= inside
    expected = slowly(silhouette, frame, color)
    np.testing.assert_array_equal(stale_outline(silhouette, frame, color), expected)
    return expected.sum()


def test_no_silhouette_has_no_outline():
    none = np.zeros((5, 6), bool)
    picture = np.zeros((5, 6, 3), np.uint8)
    assert not stale_outline(none, picture, picture.astype(np.float32)).any()
