"""Closed tubes of triangles around bones: what a generated body is made of."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.studio.dancing.limbs import unit

Track = NDArray[np.float64]
Color = tuple[int, int, int]


@dataclass(frozen=True)
class Tube:
    """A closed surface of rings, frame by frame."""

    vertex: Track
    """(time, vertex, 3), metres: ring after ring, then the middles of both ends."""
    triangle: NDArray[np.int32]
    """(triangle, 3), counter-clockwise seen from outside; 2 x around from ring to ring, then
    the ends."""
    color: NDArray[np.uint8]
    """(triangle, 3) RGB."""
    segment: NDArray[np.uint8]
    """(vertex,) label of the segment."""


def shape_stations(
    keys: Sequence[tuple[float, float, float]],
    count: int,
    scale: float,
    *,
    round_start: bool = False,
    round_end: bool = False,
) -> Track:
    """Return the rings of a tube.

    Parameters
    ----------
    keys : sequence of (share, half width, half depth)
        Share of the bone's length, 0 to 1 in order; metres.
    count : int
        Rings from share 0 to share 1; what is between the keys is interpolated.
    scale : float
        Multiplies the metres.
    round_start, round_end : bool
        Add half a ball at that end.

    Returns
    -------
    (station, 4) float64
        Share, metres beyond it along the bone, half width, half depth.
    """
    table = np.array(keys, np.float64)
    share = np.linspace(0.0, 1.0, count)
    wide, deep = (scale * np.interp(share, table[:, 0], table[:, column]) for column in (1, 2))
    stations = np.stack([share, np.zeros(count), wide, deep], axis=1)
    angle = np.radians([25.0, 50.0, 75.0])
    for end, added in ((0, round_start), (-1, round_end)):
        if not added:
            continue
        ball = np.repeat(stations[[end]], 3, axis=0)
        ball[:, 1] = (1.0 if end else -1.0) * stations[end, 2:].mean() * np.sin(angle)
        ball[:, 2:] *= np.cos(angle)[:, None]
        stations = np.concatenate([stations, ball] if end else [ball[::-1], stations])
    return stations


def tube_along(
    start: Track,
    end: Track,
    front: Track,
    stations: Track,
    label: int,
    colors: tuple[Color, Color],
    *,
    around: int = 14,
    on_front: bool = False,
) -> Tube:
    """Return a tube around a bone.

    Parameters
    ----------
    start, end, front : (time, 3) float64
        The bone, metres, and the direction of its rings' depth, at right angles to it.
    stations : (station, 4) float64
        See `shape_stations`.
    label : int
        Of the segment.
    colors : pair of RGB
        Of the checks.
    around : int
        Vertices of a ring.
    on_front : bool
        The bone is the tube's back, as the sole is of a foot, and not its middle.
    """
    along = unit(end - start)[:, None]
    share, beyond, wide, deep = (stations[:, column, None] for column in range(4))
    center = start[:, None] + share * (end - start)[:, None] + beyond * along
    if on_front:
        center = center + deep * front[:, None]
    side = np.cross(along, front[:, None])
    angle = 2.0 * np.pi * np.arange(around)[:, None] / around
    grid = (
        center[:, :, None]
        + np.cos(angle) * (wide * side)[:, :, None]
        + np.sin(angle) * (deep * front[:, None])[:, :, None]
    )
    return close_tube(grid, np.full(grid.shape[1:3], label), colors)


def close_tube(grid: Track, label: NDArray[np.integer], colors: tuple[Color, Color]) -> Tube:
    """Return a grid of rings as a closed tube.

    Parameters
    ----------
    grid : (time, station, around, 3) float64
        Metres; seen along the tube, the rings turn clockwise.
    label : (station, around) int
        Of the segment.
    colors : pair of RGB
        Of the checks, each two by two quads.
    """
    frames, stations, around, _ = grid.shape
    ends = grid[:, [0, -1]].mean(axis=2)
    vertex = np.concatenate([grid.reshape(frames, -1, 3), ends], axis=1)
    index = np.arange(stations * around).reshape(stations, around)
    turned = np.roll(index, -1, axis=1)
    low, low_next, high, high_next = index[:-1], turned[:-1], index[1:], turned[1:]
    quads = np.stack([low, high, low_next, low_next, high, high_next], axis=-1).reshape(-1, 3)
    first, last = stations * around, stations * around + 1
    caps = [
        np.stack([np.full(around, first), index[0], turned[0]], axis=-1),
        np.stack([np.full(around, last), turned[-1], index[-1]], axis=-1),
    ]
    ring, place = np.indices((stations - 1, around))
    check = np.repeat(((ring // 2 + place // 2) % 2).ravel(), 2)
    check = np.concatenate([check, np.zeros(2 * around, int)])
    return Tube(
        vertex,
        np.concatenate([quads, *caps]).astype(np.int32),
        np.array(colors, np.uint8)[check],
        np.concatenate([label.ravel(), [label[0, 0], label[-1, 0]]]).astype(np.uint8),
    )


def join_tubes(tubes: Sequence[Tube]) -> Tube:
    """Return several tubes as one surface, in their order."""
    offsets = np.cumsum([0, *(tube.vertex.shape[1] for tube in tubes)])
    return Tube(
        np.concatenate([tube.vertex for tube in tubes], axis=1),
        np.concatenate(
            [tube.triangle + offset for tube, offset in zip(tubes, offsets[:-1], strict=True)]
        ).astype(np.int32),
        np.concatenate([tube.color for tube in tubes]),
        np.concatenate([tube.segment for tube in tubes]),
    )
