"""Overviews show every camera and every doubtful frame, in its place."""

import numpy as np
import pytest

from tasks.rendering.drawing.canvas import BLUE, GRID, INK
from tasks.rendering.overviews import draw_contact_sheet, draw_quality


def near(image, color, within=30):
    return (np.abs(image.astype(int) - color) < within).all(axis=-1)


@pytest.mark.parametrize("count", [1, 3, 8, 9])
def test_every_camera_has_its_picture(count):
    silhouettes = np.zeros((count, 60, 90), np.bool_)
    silhouettes[:, 20:40, 30:60] = True
    image = draw_contact_sheet(silhouettes, [f"cam{n}" for n in range(count)])
    light, dark = near(image, GRID, 4).sum(), near(image, INK, 4).sum()
    # a ninth of each picture is the performer
    assert dark / (light + dark) == pytest.approx(1 / 9, rel=0.1)
    one = draw_contact_sheet(silhouettes[:1], ["cam0"])
    assert light == pytest.approx(count * near(one, GRID, 4).sum(), rel=0.05)


def test_a_silhouette_is_where_it_was():
    silhouettes = np.zeros((2, 50, 80), np.bool_)
    silhouettes[1, 40:, 70:] = True  # lower right of the second camera
    row, column = np.nonzero(near(draw_contact_sheet(silhouettes, ["a", "b"]), INK, 4))
    assert column.min() > 120 + 0.8 * 112
    assert row.min() > 0.7 * 70


@pytest.mark.parametrize(
    ("shape", "names"), [((0, 4, 5), 0), ((2, 4, 5), 1), ((4, 5), 4), ((1, 0, 5), 1)]
)
def test_a_sheet_of_nothing_or_without_names_is_refused(shape, names):
    with pytest.raises(ValueError, match="make no sheet"):
        draw_contact_sheet(np.zeros(shape, np.bool_), ["a"] * names)


def shaded(image):
    """Return the columns of the plot that are shaded, by a row in which no curve is."""
    row = image[40]
    return np.flatnonzero((row[:, 0].astype(int) - row[:, 2]) > 20)


@pytest.mark.parametrize("frames", [10, 640, 5000])
def test_doubtful_frames_are_shaded_where_they_are(frames):
    quality = np.full((frames, 11), 0.5)
    first, end = frames * 3 // 10, frames * 4 // 10
    doubtful = np.zeros(frames, np.bool_)
    doubtful[first:end] = True
    columns = shaded(draw_quality(quality, doubtful, 30.0))
    across = 480 - 44 - 16
    assert columns.min() == pytest.approx(44 + 0.3 * across, abs=2)
    assert columns.max() == pytest.approx(44 + 0.4 * across, abs=2)
    assert not len(shaded(draw_quality(quality, np.zeros(frames, np.bool_), 30.0)))


def test_a_single_doubtful_frame_of_many_is_seen():
    doubtful = np.zeros(100_000, np.bool_)
    doubtful[50_000] = True
    assert len(shaded(draw_quality(np.full((100_000, 1), 0.5), doubtful, 30.0)))


def test_the_worst_segment_is_drawn_as_low_as_it_is():
    quality = np.full((4000, 11), 0.9)
    quality[2000, 4] = 0.1  # one frame of several that share a column
    image = draw_quality(quality, np.zeros(4000, np.bool_), 30.0)
    rows, _ = np.nonzero(near(image[45:], BLUE, 60))
    up = 160 - 34 - 28
    assert 45 + rows.max() == pytest.approx(34 + 0.9 * up, abs=3)


def test_a_single_frame_and_numbers_beyond_their_range_are_drawn():
    image = draw_quality(np.full((1, 2), 1.7), np.ones(1, np.bool_), 30.0)
    assert image.shape == (160, 480, 3)


@pytest.mark.parametrize(("quality", "doubtful"), [((0, 11), 0), ((5, 11), 4), ((5,), 5)])
def test_what_does_not_fit_is_refused(quality, doubtful):
    with pytest.raises(ValueError, match="make no plot"):
        draw_quality(np.zeros(quality), np.zeros(doubtful, np.bool_), 30.0)
