"""Calibrations as 3x4 projection matrices, twelve numbers a file: `P = K [R | t]`."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.parts import Calibration, Parts, build_cameras, numbers_in

WANTED = "twelve numbers, the rows of a 3x4 projection matrix"


def read_matrices(path: Path, texts: dict[str, str]) -> Calibration:
    """Read a camera of each text, which has its twelve numbers; there is no distortion.

    Parameters
    ----------
    path : Path
        What to name in an error.
    texts : dict of str
        By the name of the camera.

    Raises
    ------
    InputError
        A text has other than twelve numbers, or a matrix is none of a camera.
    """
    parts = []
    for name, text in texts.items():
        numbers = numbers_in(text)
        if len(numbers) != 12:
            parts.append(Parts(name, fault=f"it has {len(numbers)} numbers, not {WANTED}"))
            continue
        parts.append(decompose(name, np.array(numbers).reshape(3, 4)))
    return Calibration(build_cameras(path, parts))


def decompose(name: str, image_from_world: NDArray[np.float64]) -> Parts:
    """Return the camera of a projection matrix, whose scale and sign do not matter.

    An RQ decomposition with a positive diagonal (Hartley and Zisserman, Multiple View Geometry,
    2nd edition, section 6.2.4).
    """
    largest = abs(image_from_world[:, :3]).max()
    if not np.isfinite(image_from_world).all() or not largest > 0:
        return Parts(name, fault="its matrix is 0 or not finite")
    scaled = image_from_world / largest
    if np.linalg.det(scaled[:, :3]) < 0:
        scaled = -scaled
    if not np.linalg.cond(scaled[:, :3]) < 1e9:
        return Parts(name, fault="its matrix is that of no camera, or of one infinitely far away")
    flipped = scaled[::-1, :3].T
    q, r = np.linalg.qr(flipped)
    signs = np.sign(np.diag(r))
    intrinsics = np.triu(((r * signs[:, None]).T)[::-1, ::-1])
    rotation = (q * signs).T[::-1]
    translation = np.linalg.solve(intrinsics, scaled[:, 3])
    return Parts(name, None, intrinsics, (), rotation, translation)
