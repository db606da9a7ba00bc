"""Tests of tasks.reconstruction.regions.pixels: pixels out of pictures and back."""

import numpy as np

from tasks.reconstruction.regions.pixels import place_pixels, take_pixels


def test_pixels_are_those_inside_and_come_back_to_their_places():
    rng = np.random.default_rng(3)
    images = rng.integers(0, 256, (4, 9, 21, 3), np.uint8)
    silhouettes = rng.random((4, 9, 21)) < np.array([0.5, 0.0, 0.05, 1.0])[:, None, None]
    packed = np.packbits(silhouettes, axis=-1)
    pixels = [take_pixels(bits, image) for bits, image in zip(packed, images, strict=True)]
    for taken, image, inside in zip(pixels, images, silhouettes, strict=True):
        np.testing.assert_array_equal(taken, image[inside])
    back = np.full_like(images, 7)
    place_pixels(packed, np.concatenate(pixels), back)
    np.testing.assert_array_equal(back[silhouettes], images[silhouettes])
    assert (back[~silhouettes] == 7).all()
    assert 200 < silhouettes.sum() < silhouettes.size - 200
