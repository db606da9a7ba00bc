"""Write pictures."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.formats.writing import write_beside


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
    import cv2  # here, because only who writes a picture should wait for it

    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"{path} does not end in .png; pictures are written as PNG")
    if image.ndim != 3 or image.shape[2] != 3 or not image.size or image.dtype != np.uint8:
        raise ValueError(
            f"a {image.dtype} array of shape {image.shape} is no picture; "
            "(row, column, 3) uint8 is wanted"
        )
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    try:
        write_beside(path, encoded.tobytes())
    except OSError as error:
        raise InputError(
            f"the picture {path} cannot be written ({error.strerror}); "
            "choose a folder that exists, has room and may be written"
        ) from error
