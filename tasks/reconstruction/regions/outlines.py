"""Draw the outline of a region to a pixel, where the colors beside it meet.

Beside the outline a pixel belongs to the region where its color is nearer to the region's color
around it than to the background's, which is taken as dark as it is around it just now. So does one
whose color no mixture of these two explains: something else, thin, of the performer's: a hand.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.engine.kernels import njit

_LOW = 2**32 - 1
"""Mask of the lower 32 bits of a number that holds two sums."""


def draw_outline(
    inside: NDArray[np.uint8],
    image: NDArray[np.uint8],
    behind: NDArray[np.float32],
    corner: tuple[int, int],
    rule: tuple[int, float, float],
) -> NDArray[np.uint8]:
    """Return a region whose outline has moved by a pixel at most.

    Parameters
    ----------
    inside : (row, column) uint8
        1 in the region, 0 outside: a box of the picture.
    image : (3, row, column) uint8
        The whole picture, a plane a channel.
    behind : (4, row, column) float32
        The background: a plane a channel, and their sum.
    corner
        Row and column of the picture at which the box begins.
    rule
        Half width of the window in which the colors beside the outline are looked for; share of the
        way from the background's color to the region's at which the outline is drawn; distance from
        all mixtures of the two beyond which a color is another one of the region's.
    """
    zone, outlined = np.empty_like(inside), np.empty_like(inside)
    _mark_zone(inside, zone)
    _draw(zone, (image, behind), corner, rule, outlined)
    return outlined


@njit(cache=True, nogil=True)
def _mark_zone(inside: Any, zone: Any) -> None:
    """Write 1 beside the outline, 2 on it, 0 outside and 3 inside; diagonal pixels are beside."""
    rows, columns = inside.shape
    every, some = np.empty(columns + 2, np.uint8), np.empty(columns + 2, np.uint8)
    for i in range(rows):
        above, line, below = inside[max(i - 1, 0)], inside[i], inside[min(i + 1, rows - 1)]
        for j in range(columns):
            every[j + 1] = above[j] & line[j] & below[j]
            some[j + 1] = above[j] | line[j] | below[j]
        every[0], every[columns + 1] = every[1], every[columns]
        some[0], some[columns + 1] = some[1], some[columns]
        for j in range(columns):
            full = every[j] & every[j + 1] & every[j + 2]
            zone[i, j] = line[j] + full + (some[j] | some[j + 1] | some[j + 2])


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(zone: Any, pictures: Any, corner: Any, rule: Any, outlined: Any) -> None:
    """Decide the pixels of zone 1 (beside the outline) and 2 (on it).

    Of the rows in reach, each column's sums are held: a row comes in, and one goes. Sums are exact
    in whatever order, for no bit is lost of the brightness of a picture.
    """
    image, behind = pictures
    reach, cut, other = rule
    rows, columns = zone.shape
    width = columns + 2 * reach  # a margin, so that no window is cut
    sums = (np.zeros(width, np.int64), np.zeros(width, np.int64), np.zeros(width, np.int64))
    shades = np.zeros(width)
    own = (
        sums[0][reach : reach + columns],
        sums[1][reach : reach + columns],
        sums[2][reach : reach + columns],
        shades[reach : reach + columns],
    )
    for i in range(-reach, rows):
        _change_rows(zone, pictures, corner, (i + reach, i - reach - 1), own)
        if i < 0:
            continue
        for j in range(columns):
            outlined[i, j] = zone[i, j] >= 2
        for j in range(columns):
            if zone[i, j] == 1 or zone[i, j] == 2:
                a = b = c = 0
                shade = 0.0
                for k in range(j, j + 2 * reach + 1):
                    a, b, c = a + sums[0][k], b + sums[1][k], c + sums[2][k]
                    shade += shades[k]
                if a & _LOW and c & _LOW and shade > 0:  # else as it was: too thin, too crowded
                    y, x = corner[0] + i, corner[1] + j
                    pixel = (image[0, y, x], image[1, y, x], image[2, y, x])
                    there = (behind[0, y, x], behind[1, y, x], behind[2, y, x])
                    outlined[i, j] = _belongs(pixel, there, (a, b, c, shade), (cut, other))


@njit(cache=True, nogil=True)
def _change_rows(zone: Any, pictures: Any, corner: Any, changed: Any, sums: Any) -> None:
    """Add a row to the sums of each column, and take one away, where there are these rows.

    Two sums are in a number: red and count, green and blue inside; brightness and count outside;
    brightness behind that.
    """
    image, behind = pictures
    first, second, third, fourth = sums
    top, left = corner
    rows, columns = zone.shape
    comes, goes = -np.int64(changed[0] < rows), -np.int64(changed[1] >= 0)  # masks of all bits
    new, old = min(changed[0], rows - 1), max(changed[1], 0)
    kind, was = zone[new], zone[old]
    y, x, end = top + new, left, left + columns
    red, green, blue = image[0, y, x:end], image[1, y, x:end], image[2, y, x:end]
    shade = behind[3, y, x:end]
    y = top + old
    red_was, green_was, blue_was = image[0, y, x:end], image[1, y, x:end], image[2, y, x:end]
    shade_was = behind[3, y, x:end]
    for j in range(columns):
        here, there = comes & -np.int64(kind[j] == 3), goes & -np.int64(was[j] == 3)
        come, go = np.int64(red[j]) << 32 | 1, np.int64(red_was[j]) << 32 | 1
        first[j] += (here & come) - (there & go)
    for j in range(columns):
        here, there = comes & -np.int64(kind[j] == 3), goes & -np.int64(was[j] == 3)
        come = np.int64(green[j]) << 32 | np.int64(blue[j])
        go = np.int64(green_was[j]) << 32 | np.int64(blue_was[j])
        second[j] += (here & come) - (there & go)
    for j in range(columns):
        here, there = comes & -np.int64(kind[j] == 0), goes & -np.int64(was[j] == 0)
        come = np.int64(red[j]) + np.int64(green[j]) + np.int64(blue[j])
        go = np.int64(red_was[j]) + np.int64(green_was[j]) + np.int64(blue_was[j])
        third[j] += (here & (come << 32 | 1)) - (there & (go << 32 | 1))
    for j in range(columns):
        here, there = comes & -np.int64(kind[j] == 0), goes & -np.int64(was[j] == 0)
        fourth[j] += np.float64(shade[j]) if here else 0.0
        fourth[j] -= np.float64(shade_was[j]) if there else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _belongs(pixel: Any, there: Any, sums: Any, rule: Any) -> Any:
    """Return whether a pixel's color is nearer to that inside than to that behind, or neither."""
    cut, other = rule
    a, b, c, behind = sums
    inside, share = a & _LOW, (c >> 32) / behind
    br, bg, bb = share * there[0], share * there[1], share * there[2]
    dr, dg, db = (a >> 32) / inside - br, (b >> 32) / inside - bg, (b & _LOW) / inside - bb
    red, green, blue = pixel[0] - br, pixel[1] - bg, pixel[2] - bb
    along, whole = red * dr + green * dg + blue * db, dr * dr + dg * dg + db * db
    beside = (red * red + green * green + blue * blue) * whole - along * along
    return along > cut * whole or beside > other * other * whole
