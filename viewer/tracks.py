"""Pack joint tracks and colored voxels for the browser: few bytes, decoded by a short loop there.

A pack of a track is a head, then 16-bit numbers (joint, space, time), each the difference to the
frame before; `LOST` as the sum says that a joint is missing. A pack of voxels is a head, then of
each frame its head and its columns: numbers of the surface voxels as differences, colors as
places in a palette, labels. All of it is little-endian, and compressed with gzip on its way.
"""

import struct

import numpy as np
from numpy.typing import NDArray

LOST = -32768
"""The 16-bit number that stands for a joint that is missing."""
_REACH = 32767.0
_TRACK_HEAD = struct.Struct("<4sHHIIIffff")
_VOXELS_HEAD = struct.Struct("<4sHHIIfffffIIII")
_FRAME_HEAD = struct.Struct("<IIII")
PALETTE = 128
"""How many colors a take is shown with. Chosen by eye: more are not told apart on a body, and
7 bits compress to less than 5."""
_BITS = 5
"""Bits of red, green and blue by which a color's place in the palette is looked up."""
_WIDE = 255
"""A difference of voxel numbers from this on is told in four bytes of its own."""


def pack_track(position: NDArray[np.floating], first: int, step: int) -> bytes:
    """Return joints over time as bytes.

    Parameters
    ----------
    position : (time, joint, 3) float, m
        NaN where a joint is missing. What lies between two numbers is a 65,534th of the widest
        axis: 0.1 mm on a stage of 6 m.
    first, step
        The take's frame of the first row, and frames from a row to the next.
    """
    frames, joints = position.shape[:2]
    flat = position.reshape(-1, 3).astype(np.float64)
    flat = np.where(np.isfinite(flat).all(axis=1, keepdims=True), flat, np.nan)
    known = flat[np.isfinite(flat[:, 0])]
    low = known.min(axis=0) if len(known) else np.zeros(3)
    high = known.max(axis=0) if len(known) else np.zeros(3)
    middle, scale = (low + high) / 2, max(float((high - low).max()) / 2 / _REACH, 1e-6)
    with np.errstate(invalid="ignore"):
        numbers = np.where(np.isfinite(flat), np.rint((flat - middle) / scale), LOST)
    numbers = numbers.astype(np.int16).reshape(frames, joints, 3).transpose(1, 2, 0)
    steps = np.diff(numbers, axis=2, prepend=np.int16(0))  # wraps, as the sum in the browser does
    head = _TRACK_HEAD.pack(b"SHTR", 1, joints, frames, first, step, scale, *middle)
    return head + np.ascontiguousarray(steps, "<i2").tobytes()


def make_palette(color: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the colors that a take is shown with, and where each color is found in them.

    Parameters
    ----------
    color : (voxel, 3) uint8
        RGB of some of the take's voxels.

    Returns
    -------
    palette : (PALETTE, 3) uint8
    place : (32768,) uint8
        By the upper 5 bits of red, green and blue.
    """
    import cv2
    from scipy.spatial import KDTree

    sample = color if len(color) else np.zeros((1, 3), np.uint8)
    sample = sample[:: max(1, len(sample) // 8000)].astype(np.float32)
    distinct = len(np.unique(sample, axis=0))
    count = min(PALETTE, distinct)
    stop = (cv2.TERM_CRITERIA_MAX_ITER + cv2.TERM_CRITERIA_EPS, 12, 1.0)
    cv2.setRNGSeed(1)
    _, _, found = cv2.kmeans(sample, count, None, stop, 1, cv2.KMEANS_PP_CENTERS)  # type: ignore[call-overload]
    found = found[np.argsort(found @ np.array([0.3, 0.6, 0.1], np.float32))]  # neighbors are alike
    palette = np.zeros((PALETTE, 3), np.uint8)
    palette[:count] = np.clip(np.rint(found), 0, 255)
    levels = (np.arange(1 << _BITS) * 8 + 4).astype(np.float64)
    grid = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    place = KDTree(palette[:count].astype(np.float64)).query(grid)[1]
    return palette, np.asarray(place, np.uint8)


def pack_voxels_head(
    shape: tuple[int, int, int],
    origin_m: tuple[float, float, float],
    voxel_m: float,
    palette: NDArray[np.uint8],
    frames: int,
    first: int,
) -> bytes:
    """Return the head of a pack of voxels."""
    head = _VOXELS_HEAD.pack(
        b"SHVX", 1, len(palette), frames, first, voxel_m, *origin_m, 0.0, *shape, 0
    )
    return head + palette.astype(np.uint8).tobytes()


def pack_voxel_frame(
    frame: int,
    number: NDArray[np.int64],
    place: NDArray[np.uint8],
    label: NDArray[np.uint8],
) -> bytes:
    """Return the surface voxels of a frame as bytes.

    Parameters
    ----------
    number : (voxel,) int
        Of each voxel in the grid, in order.
    place, label : (voxel,) uint8
        In the palette, and 0 to 11.
    """
    ahead = np.diff(number, prepend=0)
    wide = ahead >= _WIDE
    short = np.where(wide, _WIDE, ahead).astype(np.uint8)
    far = ahead[wide].astype("<u4")
    head = _FRAME_HEAD.pack(frame, len(number), len(far), 0)
    return b"".join([head, far.tobytes(), short.tobytes(), place.tobytes(), label.tobytes()])
