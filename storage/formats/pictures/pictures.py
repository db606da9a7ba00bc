"""Write pictures."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.motion.writing import write_beside


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

    if image.ndim != 3 or image.shape[2] != 3 or not image.size or image.dtype != np.uint8:
        raise ValueError(
            f"a {image.dtype} array of shape {image.shape} is no picture; "
            "(row, column, 3) uint8 is wanted"
        )
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return encoded.tobytes()
