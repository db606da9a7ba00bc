"""Write pictures."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside

_QUALITIES = (85, 75, 60, 45)
"""Qualities of WebP that are tried, of 100. Chosen by eye: below the last it shows blocks."""
_LOSSLESS = 101
"""What OpenCV calls WebP without loss."""
_SHADE = 51
"""Between two shades of a drawing's colors, of 255. Chosen by eye: edges stay smooth."""


def write_png(path: str | Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB picture as PNG: beside its place, then renamed, so never half of one.

    Parameters
    ----------
    path : str or Path
        A file that ends in ".png"; one that is there is replaced.
    image : (row, column, 3) uint8
        RGB.

    Raises
    ------
    InputError
        Where the name does not end in ".png", or the place cannot be written.
    ValueError
        Where the image is not an RGB picture.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"{path} does not end in .png; pictures are written as PNG")
    encoded = encode_png(image)
    try:
        write_beside(path, encoded)
    except OSError as error:
        raise InputError(
            f"the picture {path} cannot be written ({error.strerror}); "
            "choose a folder that exists, has room and may be written"
        ) from error


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """Return an RGB picture (row, column, 3) uint8 as the bytes of a PNG file.

    Raises
    ------
    ValueError
        Where the image is not an RGB picture.
    """
    import cv2  # here, because only who writes a picture should wait for it

    _check_picture(image)
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return encoded.tobytes()


def encode_drawing(image: NDArray[np.uint8]) -> bytes:
    """Return a drawing (row, column, 3) uint8 as the bytes of a small WebP file, its edges sharp.

    Its colors are rounded to six shades of red, green and blue each: a quarter of the bytes, and
    lines and letters look the same.

    Raises
    ------
    ValueError
        Where the image is not an RGB picture.
    """
    import cv2

    _check_picture(image)
    rounded = (np.rint(image / _SHADE) * _SHADE).astype(np.uint8)
    turned = cv2.cvtColor(rounded, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".webp", turned, [cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS])[1].tobytes()


def encode_jpeg(image: NDArray[np.uint8], quality: int) -> bytes:
    """Return an RGB picture (row, column, 3) uint8 as the bytes of a JPEG file."""
    import cv2

    turned = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", turned, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return encoded.tobytes()


def encode_within(image: NDArray[np.uint8], most_bytes: int) -> tuple[bytes, str]:
    """Return an RGB picture as the bytes of a small file, and the media type of that.

    PNG where it is small enough, since lines and letters stay sharp; else WebP, of lower quality
    and then smaller until it fits.

    Parameters
    ----------
    image : (row, column, 3) uint8
        RGB.
    most_bytes
        How long the file may be.

    Raises
    ------
    ValueError
        Where the image is not an RGB picture, or no picture is so small.
    """
    import cv2

    encoded = encode_png(image)
    if len(encoded) <= most_bytes:
        return encoded, "image/png"
    turned = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    while True:
        for quality in _QUALITIES:
            _, content = cv2.imencode(".webp", turned, [cv2.IMWRITE_WEBP_QUALITY, quality])
            if len(content) <= most_bytes:
                return content.tobytes(), "image/webp"
        rows, columns = turned.shape[0] // 2, turned.shape[1] // 2
        if not (rows and columns):
            raise ValueError(f"no picture has {most_bytes} bytes; allow more")
        turned = cv2.resize(turned, (columns, rows), interpolation=cv2.INTER_AREA)


def _check_picture(image: NDArray[np.uint8]) -> None:
    """Refuse what is not an RGB picture."""
    if image.ndim != 3 or image.shape[2] != 3 or not image.size or image.dtype != np.uint8:
        raise ValueError(
            f"a {image.dtype} array of shape {image.shape} is no picture; "
            "(row, column, 3) uint8 is wanted"
        )
