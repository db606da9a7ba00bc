"""Tests of tasks.reconstruction.regions.pixels: pixels out of pictures, and which is where."""

import numpy as np

from tasks.reconstruction.regions.pixels import number_pixels, take_pixels


def test_pixels_are_those_inside_and_are_found_by_their_places():
    rng = np.random.default_rng(3)
    images = rng.integers(0, 256, (4, 9, 149, 3), np.uint8)
    silhouettes = rng.random((4, 9, 149)) < np.array([0.5, 0.0, 0.05, 1.0])[:, None, None]
    packed = np.packbits(silhouettes, axis=-1)
    pixels = [take_pixels(bits, image) for bits, image in zip(packed, images, strict=True)]
    for taken, image, inside in zip(pixels, images, silhouettes, strict=True):
        np.testing.assert_array_equal(taken, image[inside])
    pixel = np.full((4, 9 * 149, 2), -1, np.int32)
    for places, inside in zip(pixel, silhouettes, strict=True):
        places[: inside.sum()] = np.argwhere(inside)
    number = number_pixels(packed, pixel)
    asked = pixel[..., 0] >= 0
    np.testing.assert_array_equal(number[asked], np.arange(silhouettes.sum()))
    assert (number[~asked] == -1).all()
    assert 200 < silhouettes.sum() < silhouettes.size - 200
