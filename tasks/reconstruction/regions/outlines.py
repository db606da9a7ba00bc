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

    They are few, so that only the columns in their reach are summed. Sums are exact in whatever
    order, for no bit is lost of the brightness of a picture.
    """
    image, behind = pictures
    reach, cut, other = rule
    rows, columns = zone.shape
    sums = (np.empty(columns, np.int64), np.empty(columns, np.int64), np.empty(columns, np.int64))
    shades, held = np.empty(columns), np.full(columns, -2)
    for i in range(rows):
        for j in range(columns):
            outlined[i, j] = zone[i, j] >= 2
        begin, end = _next_run(zone[i], 0)
        while begin < columns:
            span = (max(begin - reach, 0), min(end + reach, columns))
            _sum_columns(zone, pictures, corner, (i, reach), span, sums, shades, held)
            for j in range(begin, end):
                a = b = c = 0
                shade = 0.0
                for k in range(max(j - reach, 0), min(j + reach + 1, columns)):
                    a, b, c = a + sums[0][k], b + sums[1][k], c + sums[2][k]
                    shade += shades[k]
                if a & _LOW and c & _LOW and shade > 0:  # else as it was: too thin, too crowded
                    y, x = corner[0] + i, corner[1] + j
                    pixel = (image[0, y, x], image[1, y, x], image[2, y, x])
                    there = (behind[0, y, x], behind[1, y, x], behind[2, y, x])
                    outlined[i, j] = _belongs(pixel, there, (a, b, c, shade), (cut, other))
            begin, end = _next_run(zone[i], end)


@njit(cache=True, nogil=True)
def _next_run(zone: Any, column: Any) -> Any:
    """Return where pixels of a row that are to be decided begin, from a column on, and end."""
    while column < len(zone) and (zone[column] == 0 or zone[column] == 3):
        column += 1
    end = column
    while end < len(zone) and zone[end] != 0 and zone[end] != 3:
        end += 1
    return column, end


@njit(cache=True, nogil=True)
def _sum_columns(
    zone: Any, pictures: Any, corner: Any, reached: Any, span: Any, sums: Any, shades: Any,
    held: Any,
) -> None:  # fmt: skip
    """Make the sums of some columns those of the rows in reach of a row.

    Where they are those of the row above it, a row goes, and one comes in. Two sums are in a
    number: red and count, green and blue inside; brightness and count outside; brightness behind
    that.
    """
    image, behind = pictures
    middle, reach = reached
    first, second, third = sums
    for k in range(span[0], span[1]):
        if held[k] == middle:
            continue
        row, steps, sign = middle - reach, 2 * reach + 1, 1
        if held[k] == middle - 1:
            row, steps, sign = row - 1, 2, -1
        else:
            first[k] = second[k] = third[k] = 0
            shades[k] = 0.0
        held[k] = middle
        for _ in range(steps):
            if 0 <= row < len(zone):
                y, x = corner[0] + row, corner[1] + k
                red, green, blue = image[0, y, x], image[1, y, x], image[2, y, x]
                if zone[row, k] == 3:
                    first[k] += sign * (np.int64(red) << 32 | 1)
                    second[k] += sign * (np.int64(green) << 32 | np.int64(blue))
                elif zone[row, k] == 0:
                    bright = np.int64(red) + np.int64(green) + np.int64(blue)
                    third[k] += sign * (bright << 32 | 1)
                    shades[k] += sign * np.float64(behind[3, y, x])
            row, sign = (middle + reach, 1) if sign < 0 else (row + 1, 1)


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
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
