"""Draw motion: rows of stick figures, and a match laid over its query.

Pictures are what the retrieval paper prints: snapshots (figures 9-10), a query and a match in
one place (figure 8).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.engine.settings import Count, Finite, Positive, check_ranges
from tasks.motion.stature import DEFAULT_STATURE_M, take_stature
from tasks.rendering.drawing.canvas import (
    BLUE,
    GRAY,
    GRID,
    INK,
    ORANGE,
    Color,
    Image,
    blank,
    draw_legend,
    draw_line,
    draw_text,
    finish,
)
from tasks.rendering.drawing.stick_figures import draw_figure
from tasks.retrieval.normalization import INDEX_RATE_HZ, pack_motion


@dataclass(frozen=True)
class FigureSettings:
    """How stick figures are drawn; lengths in pixels of the finished picture."""

    width: Count = 1200
    """Width of the picture [px]. Chosen by eye; not measured."""
    figure_height: Count = 250
    """Height given to the tallest figure [px]. Chosen by eye; not measured."""
    aside: Finite = 0.5
    """How far the viewer stands to the performer's left of straight ahead [rad]. Chosen by eye:
    right and left limbs do not cover each other."""
    above: Finite = 0.14
    """How far the viewer looks down [rad]. Chosen by eye; not measured."""
    thickness: Positive = 4.0
    """Thickness of the lines of a figure 140 px to the metre [px]. Chosen by eye; not measured."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_ranges(self)


def draw_stick_figures(
    position: NDArray[np.floating],
    frames: Sequence[int],
    *,
    title: str = "",
    rate_hz: float | None = None,
    color: Color = BLUE,
    settings: FigureSettings = FigureSettings(),
) -> Image:
    """Return a row of stick figures.

    All figures are seen from where the viewer of the first one stands, so a turn is seen to
    turn; each stands in the middle of its place, so its path over the floor is not seen. The
    right arm and leg are darker.

    Parameters
    ----------
    position : (time, 21, 3) float
        Metres, joints in the order of the archive; lines to a missing joint are left out.
    frames : sequence of int
        The frames to draw, from left to right.
    title : str
        Written above.
    rate_hz : float, optional
        If given, seconds stand below the frame numbers.
    color
        RGB of the figures.

    Returns
    -------
    (row, column, 3) uint8
        RGB.

    Raises
    ------
    ValueError
        Where there are no frames, or one is not a frame of the motion.
    """
    _check_motion(position)
    wrong = [frame for frame in frames if not 0 <= frame < len(position)]
    if not len(frames) or wrong:
        raise ValueError(
            f"frames {list(frames)} cannot all be drawn; "
            f"give at least one, each within 0-{len(position) - 1}"
        )
    poses = np.array(position[list(frames)], dtype=np.float64)
    poses -= _over(poses)[:, None] * [1.0, 0.0, 1.0]
    poses = poses @ _front(poses).T
    labels = [
        (f"{frame}", "" if rate_hz is None else f"{frame / rate_hz:.1f} s") for frame in frames
    ]
    return _draw_row([(poses, color)], labels, title, settings)


def draw_overlay(
    query: NDArray[np.floating],
    match: NDArray[np.floating],
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    instants: int = 6,
    title: str = "",
    query_stature_m: float | None = None,
    match_stature_m: float | None = None,
    joints: Sequence[str] = JOINTS,
    names: tuple[str, str] = ("query", "match"),
    starts: tuple[int, int] = (0, 0),
    settings: FigureSettings = FigureSettings(),
) -> Image:
    """Return a match laid over its query at some instants: blue and orange.

    Both are drawn as the search compares them: hips in one place, facing the same way, in
    statures (retrieval paper, 3.3).

    Parameters
    ----------
    query, match : (time, 21, 3) float
        The two clips, metres, each with its own number of frames.
    pairs : sequence of (query frame, match frame), optional
        The warping path, counted from the start of each clip; by default time is stretched
        evenly.
    instants : int
        How many figures.
    query_stature_m, match_stature_m : float, optional
        Of the whole takes; by default measured in the clips.
    joints : sequence of str
        What was searched with; lines to other joints are drawn faint.
    names : (str, str)
        For the legend.
    starts : (int, int)
        The frame of its take at which each clip starts, for the labels.

    Returns
    -------
    (row, column, 3) uint8
        RGB.

    Raises
    ------
    ValueError
        Where a clip has no frames, or no instant is asked for.
    """
    for clip in (query, match):
        _check_motion(clip)
    if instants < 1:
        raise ValueError(f"{instants} instants cannot be drawn; ask for at least one")
    if pairs is None:
        steps = np.linspace(0.0, 1.0, instants)[:, None]
        chosen = np.rint(steps * [len(query) - 1, len(match) - 1]).astype(int)
    else:
        chosen = np.asarray(pairs)[np.rint(np.linspace(0, len(pairs) - 1, instants)).astype(int)]
    blue = _normalized(query, query_stature_m)[chosen[:, 0]]
    orange = _normalized(match, match_stature_m)[chosen[:, 1]]
    lowest = np.nanmin(np.concatenate([blue, orange])[:, :, 1], initial=0.0)
    figures = [(blue - [0.0, lowest, 0.0], BLUE), (orange - [0.0, lowest, 0.0], ORANGE)]
    labels = [(f"{a + starts[0]}", f"{b + starts[1]}") for a, b in chosen]
    image = _draw_row(figures, labels, title, settings, frozenset(joints), (BLUE, ORANGE))
    draw_legend(image, list(zip(names, (BLUE, ORANGE), strict=True)), row=36)
    return image


def _check_motion(position: NDArray[np.floating]) -> None:
    """Refuse what is not a motion of the 21 joints."""
    if position.ndim != 3 or position.shape[1:] != (len(JOINTS), 3) or not len(position):
        raise ValueError(
            f"positions of shape {position.shape} cannot be drawn; (time, {len(JOINTS)}, 3) "
            "with at least one frame is wanted"
        )


def _over(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the point (time, 3) that a pose is centered on: its hips, or what it has."""
    hips = poses[:, [JOINTS.index("RHip"), JOINTS.index("LHip")]].mean(axis=1)
    seen = np.isfinite(poses).all(axis=2, keepdims=True)
    mean = np.where(seen, poses, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return np.where(np.isfinite(hips), hips, mean)


def _front(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the turn (3, 3) that lets the first pose with hips face +z, its left at +x."""
    across = poses[:, JOINTS.index("LHip")] - poses[:, JOINTS.index("RHip")]
    across = across[np.isfinite(across).all(axis=1)]
    if not len(across) or not np.hypot(*across[0, ::2]):
        return np.eye(3)
    x, z = across[0, ::2] / np.hypot(*across[0, ::2])
    return np.array([[x, 0.0, z], [0.0, 1.0, 0.0], [-z, 0.0, x]])


def _normalized(position: NDArray[np.floating], stature_m: float | None) -> NDArray[np.float64]:
    """Return (time, joint, 3) as compared by the search, facing +z, at the usual stature."""
    stature_m = stature_m or take_stature(position)
    rows = pack_motion(position, INDEX_RATE_HZ, stature_m)[: 3 * len(JOINTS)]
    x, y, z = np.moveaxis(rows.reshape(len(JOINTS), 3, -1).astype(np.float64), 1, 0)
    return DEFAULT_STATURE_M * np.stack([z.T, y.T, -x.T], axis=2)


def _draw_row(
    figures: Sequence[tuple[NDArray[np.float64], Color]],
    labels: Sequence[tuple[str, str]],
    title: str,
    settings: FigureSettings,
    strong: frozenset[str] = frozenset(JOINTS),
    label_colors: tuple[Color, Color] = (INK, GRAY),
) -> Image:
    """Return figures side by side on their patches of floor; several in one place overlap."""
    count = len(labels)
    heads = np.concatenate([poses[:, :, 1].ravel() for poses, _ in figures])
    tallest = max(float(np.nanmax(heads, initial=0.5)), 0.5)
    cell = (settings.width - 40) / count
    scale = min(settings.figure_height / tallest, 1.1 * cell)
    top = 64 if title else 24
    floor = top + round(scale * tallest) + 14
    below = 20 + round(0.5 * scale * np.sin(settings.above))
    height = floor + below + 44
    image = blank(height, settings.width)
    view = _view(settings)

    def place(number: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
        seen = points @ view.T
        middle = 20 + cell * (number + 0.5)
        return np.stack(
            [middle + scale * seen[..., 0], floor - scale * seen[..., 1], seen[..., 2]], axis=-1
        )

    for number in range(count):
        _draw_floor(image, lambda points, n=number: place(n, points), min(0.5, 0.34 * cell / scale))
    for number in range(count):
        for above, (poses, color) in enumerate(figures):
            wider = 1.6 if above + 1 < len(figures) else 1.0  # a rim, also where covered
            thickness = wider * settings.thickness * min(scale / 140.0, 1.2)
            at = dict(zip(JOINTS, place(number, poses[number]), strict=True))
            draw_figure(image, at, color, thickness, strong)
    image = finish(image)
    for number, lines in enumerate(labels):
        middle = 20 + cell * (number + 0.5)
        for line, (text, color) in enumerate(zip(lines, label_colors, strict=True)):
            draw_text(image, text, (middle, floor + below + 16 + 18 * line), 14, color, "center")
    draw_text(image, title, (24, 36), 20, INK, weight=600)
    return image


def _view(settings: FigureSettings) -> NDArray[np.float64]:
    """Return the turn (3, 3) from the floor to the viewer: right, up, toward the viewer."""
    c, s = np.cos(settings.aside), np.sin(settings.aside)
    around = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    c, s = np.cos(settings.above), np.sin(settings.above)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ around


def _draw_floor(image: Image, place: Callable[..., NDArray[np.float64]], half_m: float) -> None:
    """Draw a patch of floor below a figure."""
    for offset in np.linspace(-half_m, half_m, 5):
        for ends in (
            [(offset, 0.0, -half_m), (offset, 0.0, half_m)],
            [(-half_m, 0.0, offset), (half_m, 0.0, offset)],
        ):
            start, end = place(np.array(ends))
            draw_line(image, start[:2], end[:2], GRID, 1.0)
