"""Draw a stick figure: the joints of the archive by name, joined by lines."""

from collections.abc import Collection, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.rendering.drawing.canvas import FINE, Color, Image, blend, draw_line

_SPINE = (("Neck", "Waist"), ("RShoulder", "Neck"), ("Neck", "LShoulder"))
_LOINS = (("Waist", "RHip"), ("Waist", "LHip"), ("RHip", "LHip"))
_SIDE = (
    *(("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Fin")),
    *(("Hip", "Knee"), ("Knee", "Ankle"), ("Ankle", "Heel"), ("Heel", "Foot"), ("Ankle", "Foot")),
)
FIGURE_LINES = _SPINE + _LOINS + tuple((s + a, s + b) for s in "RL" for a, b in _SIDE)
"""The lines of a stick figure, by the names of their joints."""


def draw_figure(
    image: Image,
    at: Mapping[str, NDArray[np.float64]],
    color: Color,
    thickness: float,
    strong: Collection[str],
) -> None:
    """Draw one stick figure, what is far away first.

    Parameters
    ----------
    image : (row, column, 3) uint8
        A picture that is still large; drawn into.
    at : mapping of (3,) float64
        Column, row and nearness of each joint; lines to what is not finite are left out.
    color
        RGB; the right side becomes darker, the left lighter.
    thickness : float
        Of the lines, pixels of the finished picture.
    strong : collection of str
        The joints to draw in full color; lines to no other are thinned out.
    """
    seen = {name for name, point in at.items() if np.isfinite(point).all()}
    trunk = [name for name in ("RShoulder", "LShoulder", "LHip", "RHip") if name in seen]
    if len(trunk) == 4 and seen.issubset(strong):
        corners = np.rint(np.array([at[name][:2] for name in trunk]) * FINE).astype(np.int32)
        cv2.fillConvexPoly(image, corners, blend(color, 0.16), cv2.LINE_AA)
    lines = [pair for pair in FIGURE_LINES if seen.issuperset(pair)]
    if "Waist" not in seen:
        lines += [(a, b) for a, b in (("Neck", "RHip"), ("Neck", "LHip")) if {a, b} <= seen]
    for a, b in sorted(lines, key=lambda pair: at[pair[0]][2] + at[pair[1]][2]):
        share = 1.0 if {a, b} & set(strong) else 0.25
        shade = _shade(color, a if a[0] in "RL" else b)
        draw_line(image, at[a][:2], at[b][:2], blend(shade, share), thickness)
    if {"Head", "Neck"} <= seen:
        top, neck = at["Head"][:2], at["Neck"][:2]
        radius = 0.36 * float(np.linalg.norm(top - neck))
        share = 1.0 if {"Head", "Neck"} & set(strong) else 0.25
        middle = top + 0.36 * (neck - top)
        draw_line(image, neck, middle, blend(color, share), thickness)
        center = tuple(int(v) for v in np.rint(middle * FINE * 16))
        cv2.circle(
            image, center, round(radius * FINE * 16), blend(color, share), -1, cv2.LINE_AA, 4
        )


def _shade(color: Color, joint: str) -> Color:
    """Return the color of a side: the right darker, the left lighter."""
    if joint in ("Neck", "Waist"):
        return color
    if joint[0] == "R":
        r, g, b = (round(0.72 * value) for value in color)
        return r, g, b
    return blend(color, 0.72)
