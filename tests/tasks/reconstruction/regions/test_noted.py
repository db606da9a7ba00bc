"""What is noted stretch after stretch is what a plain loop over all frames finds."""

import numpy as np
import pytest

from tasks.reconstruction.regions.masks import mask_facts
from tasks.reconstruction.regions.noted import note_masks, note_outlines, nothing_noted
from tasks.reconstruction.regions.rims import edge_profile
from tasks.reconstruction.regions.stale_outlines import stale_outline

FRAMES, SIZES = 9, ((24, 30), (20, 37))
SOME = (0, 3, 4, 8)
STRETCHES = ((0, 4), (4, 9))


@pytest.fixture
def films():
    """By camera: films, silhouettes, and a background in which somebody stood."""
    rng = np.random.default_rng(3)
    made = []
    for rows, columns in SIZES:
        film = rng.integers(90, 110, (FRAMES, rows, columns, 3)).astype(np.uint8)
        seen = np.zeros((FRAMES, rows, columns), np.bool_)
        for t in range(FRAMES):
            seen[t, 5:15, 4 + t : 12 + t] = True
            if t % 2:
                film[t][seen[t]] = (200, 40, 30)
        color = np.full((rows, columns, 3), 100, np.float32)
        color[5:15, 6:14] = (30, 200, 40)
        made.append((film, seen, color))
    return made


def test_outlines_are_noted_of_the_frames_that_were_asked_for(films):
    noted = nothing_noted(SOME, len(films), (24, 37))
    for first, end in STRETCHES:
        for camera, (film, seen, color) in enumerate(films):
            note_outlines(noted, camera, first, film[first:end], color, seen[first:end])
    assert noted.stale.any()
    for n, t in enumerate(SOME):
        for camera, (film, seen, color) in enumerate(films):
            rows, columns = SIZES[camera]
            found = np.unpackbits(noted.stale[n, camera], axis=-1).astype(bool)
            expected = stale_outline(seen[t], film[t], color)
            np.testing.assert_array_equal(found[:rows, :columns], expected)
            assert found.sum() == expected.sum()
    assert not noted.masks.any()


def test_masks_are_noted_of_the_frames_that_were_asked_for(films):
    noted = nothing_noted(SOME, len(films), (24, 37))
    masks = [np.where(seen, 255, 7 * camera).astype(np.uint8) for camera, (_, seen, _) in
             enumerate(films)]  # fmt: skip
    for first, end in STRETCHES:
        for camera, (film, seen, _) in enumerate(films):
            part = slice(first, end)
            note_masks(noted, camera, first, film[part], masks[camera][part], seen[part])
    for n, t in enumerate(SOME):
        for camera, (film, seen, _) in enumerate(films):
            np.testing.assert_array_equal(noted.masks[n, camera], mask_facts(masks[camera][t]))
            np.testing.assert_array_equal(noted.edges[n, camera], edge_profile(film[t], seen[t]))
    assert np.isfinite(noted.edges).any()
    assert not noted.stale.any()
