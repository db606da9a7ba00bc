"""Find what a camera sees where nobody dances in the frames of its film.

Of each pixel some frames all over the film are sorted into groups of like colors. Where nothing but
one color is seen up to the border of the picture, that is the stage. From there the stage is
followed into the picture, the likeliest pixel first: of a pixel's groups the one is taken that is
most like the stage beside it, for the performer differs from it. So he may stand at a place for
most of the film, as long as he is away for a little. (Choosing among groups of colors by what is
around: Colombari and Fusiello, "Patch-based background initialization in heavily cluttered video",
2010; here by pixels.) Where he never leaves, the color of the stage around is a guess.
"""

import heapq
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import Background, measure_gain, smooth
from tasks.engine.kernels import njit

_ALIKE = 12
"""How far a channel may be from that of the group's first color [levels of 0 to 255]. Noise, codec
and what is left of flicker stay below; chosen by eye on the shared captures."""

_MOST_GROUPS = 12
"""How many groups of colors a pixel may have [groups]. More are counted with none."""

KEPT = 4
"""How many of the largest groups may be the stage [groups]. Chosen by eye; not measured."""

_LEAST_SEEN = 0.08
"""In how many of the frames the stage is seen at a pixel at least [share]. 4 of 48 frames."""

ALONE = 0.9
"""In how many of the frames a color is seen where nobody comes [share]. Not all: of noise and what
passes something is left."""

_FAR = 10.0
"""How far a channel of a pixel is from the stage beside it where it may be none [levels of 0 to
255]. On four rendered captures 8 and 12 find the same; with 24 it creeps over blurred edges."""

_ALL_AROUND = 0.9
"""Of how much of what is around a place the stage is seen at once where it is of the stage [share].
Not all: of noise and shadows something is left; chosen by eye on the shared captures."""


def estimate_background(images: NDArray[np.uint8]) -> Background:
    """Return the background of a camera from frames of a film in which somebody dances.

    Parameters
    ----------
    images : (image, row, column, 3) uint8
        RGB, as filmed, spread over the film: some 50. They are smoothed in place.

    Returns
    -------
    Background
        `sure` is the share of the picture in which the stage was seen.
    """
    smooth_alike(images)
    color, noise, seen = find_groups(images, np.ones(images.shape[:3], np.bool_), KEPT)
    return follow_stage(images, (color, noise, seen), _seeds(seen))


def follow_stage(
    images: NDArray[np.uint8],
    groups: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    seeds: NDArray[np.bool_],
) -> Background:
    """Return the background that is found from where the stage is known.

    Parameters
    ----------
    images : (image, row, column, 3) uint8
        Smoothed, of one brightness.
    groups
        What `find_groups` found of them.
    seeds : (row, column) bool
        Where the first group is the stage.
    """
    color, noise, seen = groups
    chosen = np.where(seeds, 0, -1)
    _follow(color, seen, chosen)
    at = np.maximum(chosen, 0)[None]
    found = np.take_along_axis(color, at[..., None], axis=0)[0]
    never = _complete(images, found, chosen < 0)
    found = fill(found, ~never)
    spread = np.take_along_axis(noise, at, axis=0)[0]
    spread = np.maximum(spread, np.median(spread)).astype(np.float32)
    return Background(found, spread, float((~never).mean()))


def _complete(
    images: NDArray[np.uint8], found: NDArray[np.float32], rest: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Write the colors of places to which the stage could not be followed, where they are shown.

    That is in frames in which all around them the stage is seen at once: around a chair in most,
    around where the performer stays when he leaves it. Returned are the places (row, column) that
    he never leaves.
    """
    never = np.zeros(rest.shape, np.bool_)
    count, part, boxes, _ = cv2.connectedComponentsWithStats(rest.view(np.uint8), connectivity=8)
    for n in range(1, count):
        left, top, width, height = boxes[n, :4]
        box = np.s_[max(top - 1, 0) : top + height + 1, max(left - 1, 0) : left + width + 1]
        inside = part[box] == n
        beside = cv2.dilate(inside.view(np.uint8), np.ones((3, 3), np.uint8)) > inside
        away = np.abs(images[:, *box][:, beside] - found[box][beside]).max(axis=2)
        shown = (away <= _ALIKE).mean(axis=1) >= _ALL_AROUND
        if shown.any():
            found[box][inside] = np.median(images[shown][:, *box][:, inside], axis=0)
        else:
            never[box] |= inside
    return never


def fill(color: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return a picture in which what is not known has the color of what is known around it."""
    if known.all() or not known.any():
        return color
    weight, reach = known.astype(np.float32), 2
    filled = color * weight[..., None]
    while not (weight > 0).all():
        size = (2 * reach + 1, 2 * reach + 1)
        around, colors = cv2.blur(weight, size), cv2.blur(filled, size)
        new = (weight == 0) & (around > 0.01)
        filled[new] = colors[new] / around[new][:, None]
        weight[new] = 1.0
        reach *= 2
    return filled


def smooth_alike(images: NDArray[np.uint8]) -> None:
    """Smooth pictures of one camera, and bring them to the brightness of the first, in place."""
    for image in images:
        image[:] = smooth(image)
    first = Background(images[0].astype(np.float32), np.zeros(images.shape[1:3], np.float32))
    for image in images[1:]:
        gain = measure_gain(image, first)
        image[:] = np.clip(np.rint(image / gain), 0, 255)


def find_groups(
    images: NDArray[np.uint8], counted: NDArray[np.bool_], most: int = 1
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return the most frequent colors of each pixel, the most frequent one first.

    Parameters
    ----------
    images : (image, row, column, 3) uint8
        Smoothed, of one brightness.
    counted : (image, row, column) bool
        Which of them count at a pixel.
    most
        How many groups.

    Returns
    -------
    color : (group, row, column, 3) float32
        The mean of each group; black where there is none.
    noise : (group, row, column) float32
        Standard deviation of a channel in it.
    seen : (group, row, column) float32
        Share of the images that are in it.
    """
    size = (most, *images.shape[1:3])
    color, noise = np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)
    seen = np.zeros(size, np.float32)
    _group(images, counted, color, noise, seen)
    return color, noise, seen


def _seeds(seen: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the pixels where nobody comes, up to the border of the picture; all, if there is none.

    A performer who never leaves a place is not reached from there.
    """
    alone = (seen[0] >= ALONE).view(np.uint8)
    return touches_border(alone) if touches_border(alone).any() else np.ones_like(alone, np.bool_)


def touches_border(region: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the parts of a region (row, column) that reach the border of the picture."""
    part: Any
    count, part = cv2.connectedComponents(region, connectivity=4)
    reaches = np.zeros(count, np.bool_)
    for line in (part[0], part[-1], part[:, 0], part[:, -1]):
        reaches[line] = True
    reaches[0] = False
    return reaches[part]


@njit(cache=True, nogil=True)
def _follow(color: Any, seen: Any, chosen: Any) -> None:
    """Choose a group for each pixel that has none, from those that have one on, the nearest first.

    A pixel whose groups are all far from what is beside it stays without.
    """
    rows, columns = chosen.shape
    waiting = [(np.float64(0.0), -1, -1)]
    for i in range(rows):
        for j in range(columns):
            _wait(color, seen, chosen, (i, j), waiting)
    while len(waiting) > 0:
        away, i, j = heapq.heappop(waiting)
        if i < 0 or chosen[i, j] >= 0:
            continue
        now, group = _nearest(color, seen, chosen, (i, j))
        if now > away:  # more is chosen beside it since
            heapq.heappush(waiting, (now, i, j))
            continue
        if now > _FAR:
            break
        chosen[i, j] = group
        for y in range(max(i - 1, 0), min(i + 2, rows)):
            for x in range(max(j - 1, 0), min(j + 2, columns)):
                _wait(color, seen, chosen, (y, x), waiting)


@njit(cache=True, nogil=True)
def _wait(color: Any, seen: Any, chosen: Any, place: Any, waiting: Any) -> None:
    """Let a pixel without a group wait for its turn, where something beside it has one."""
    if chosen[place[0], place[1]] < 0:
        away, group = _nearest(color, seen, chosen, place)
        if group >= 0:
            heapq.heappush(waiting, (away, place[0], place[1]))


@njit(cache=True, nogil=True)
def _nearest(color: Any, seen: Any, chosen: Any, place: Any) -> Any:
    """Return how far a pixel's nearest group is from what is chosen beside it, and which it is."""
    i, j = place
    total, count = np.zeros(3), 0
    for y in range(max(i - 1, 0), min(i + 2, chosen.shape[0])):
        for x in range(max(j - 1, 0), min(j + 2, chosen.shape[1])):
            if chosen[y, x] >= 0:
                count += 1
                for k in range(3):
                    total[k] += color[chosen[y, x], y, x, k]
    if count == 0:
        return np.inf, -1
    least, nearest = np.inf, -1
    for g in range(len(color)):
        if seen[g, i, j] >= _LEAST_SEEN:
            away = 0.0
            for k in range(3):
                away = max(away, abs(color[g, i, j, k] - total[k] / count))
            if away < least:
                least, nearest = away, g
    return least, nearest


@njit(cache=True, nogil=True)
def _group(images: Any, counted: Any, color: Any, noise: Any, seen: Any) -> None:
    """Sort the colors of each pixel into groups, and write what is known of the largest."""
    count = images.shape[0]
    head, size = np.empty((_MOST_GROUPS, 3), np.int64), np.empty(_MOST_GROUPS, np.int64)
    for i in range(images.shape[1]):
        for j in range(images.shape[2]):
            groups = _sort(images[:, i, j], counted[:, i, j], head, size)
            for g in range(min(groups, len(color))):
                best = np.argmax(size[:groups])
                members = _measure(images[:, i, j], counted[:, i, j], head[best], color[g, i, j])
                noise[g, i, j], seen[g, i, j] = members[1], members[0] / count
                size[best] = 0


@njit(cache=True, nogil=True)
def _sort(colors: Any, counted: Any, head: Any, size: Any) -> Any:
    """Write the first color and the size of each group of a pixel's colors; return how many."""
    groups = 0
    for n in range(len(colors)):
        if not counted[n]:
            continue
        found = 0
        while found < groups and not _is_alike(colors[n], head[found]):
            found += 1
        if found == _MOST_GROUPS:
            continue
        if found == groups:
            groups, size[found] = groups + 1, 0
            for k in range(3):
                head[found, k] = colors[n, k]
        size[found] += 1
    return groups


@njit(cache=True, nogil=True)
def _measure(colors: Any, counted: Any, head: Any, color: Any) -> Any:
    """Write the mean of the colors that are like one; return how many they are, and their noise."""
    total, square, members = np.zeros(3), 0.0, 0
    for n in range(len(colors)):
        if counted[n] and _is_alike(colors[n], head):
            members += 1
            for k in range(3):
                value = np.float64(colors[n, k])
                total[k] += value
                square += value * value
    total /= members
    color[:] = total
    spread = square / members - (total * total).sum()
    return members, np.sqrt(max(spread, 0.0) / 3.0)


@njit(cache=True, nogil=True)
def _is_alike(color: Any, other: Any) -> Any:
    far = 0
    for k in range(3):
        far = max(far, abs(np.int64(color[k]) - other[k]))
    return far <= _ALIKE
