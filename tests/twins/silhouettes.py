"""Slow twins of the silhouette rules: loops and float64, written from the definitions."""

import numpy as np


def smooth(image):
    """Return the picture smoothed by 1-2-1 both ways; its border is mirrored without repeating."""
    rows, columns, _ = image.shape
    padded = np.pad(image.astype(int), ((1, 1), (1, 1), (0, 0)), mode="reflect")
    out = np.zeros(image.shape, np.uint8)
    for i in range(rows):
        for j in range(columns):
            total = np.zeros(3, int)
            for di, wi in enumerate((1, 2, 1)):
                for dj, wj in enumerate((1, 2, 1)):
                    total += wi * wj * padded[i + di, j + dj]
            out[i, j] = (total + 8) // 16
    return out


def gain(image, color):
    """Return the brightness of a frame beside the background's, of every third pixel."""
    pairs = []
    for i in range(0, image.shape[0], 3):
        for j in range(0, image.shape[1], 3):
            seen, behind = float(sum(map(int, image[i, j]))), float(sum(color[i, j]))
            if behind > 60 and seen < 750:
                pairs.append((seen, behind))
    if not pairs:
        return 1.0
    middle = float(np.median([seen / behind for seen, behind in pairs]))
    near = [(s, b) for s, b in pairs if abs(s / b - middle) <= 0.1 * middle]
    return min(max(sum(s for s, _ in near) / sum(b for _, b in near), 0.5), 2.0)


def distortion(pixel, behind, darkest, brightest):
    """Return how far a color is from every brightness of another between the limits."""
    shares = np.linspace(darkest, brightest, 1001)
    return np.linalg.norm(pixel - shares[:, None] * behind, axis=1).min()


def chroma(pixel):
    """Return Cr and Cb of ITU-R BT.601, without their offset."""
    r, g, b = (float(channel) for channel in pixel)
    y = 0.299 * r + 0.587 * g + 0.114 * b
    return 0.713 * (r - y), 0.564 * (b - y)


def outline(image, color, inside, reach, cut, other=np.inf):
    """Return a region with the pixels along its outline decided by the colors beside it."""
    rows, columns = inside.shape
    near = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1)]

    def around(i, j):
        """Whether the pixels around (i, j) are inside; the border's repeats outward."""
        return [
            inside[min(max(i + di, 0), rows - 1), min(max(j + dj, 0), columns - 1)]
            for di, dj in near
        ]

    sure = np.array([[all(around(i, j)) for j in range(columns)] for i in range(rows)])
    away = np.array([[not any(around(i, j)) for j in range(columns)] for i in range(rows)])
    out = inside.copy()
    for i in range(rows):
        for j in range(columns):
            if sure[i, j] or away[i, j]:
                continue
            window = (slice(max(i - reach, 0), i + reach + 1),
                      slice(max(j - reach, 0), j + reach + 1))  # fmt: skip
            front = image[window][sure[window]].astype(float)
            back = away[window]
            if not len(front) or not back.any():
                continue
            share = image[window][back].sum(dtype=float) / color[window][back].sum(dtype=float)
            behind = share * color[i, j].astype(float)
            toward = front.mean(axis=0) - behind
            own, length = image[i, j] - behind, np.linalg.norm(toward)
            rest = own - (own @ toward) * toward / length**2  # what no mixture explains
            out[i, j] = own @ toward > cut * length**2 or np.linalg.norm(rest) > other
    return out


def without_small_components_and_holes(region, least, hole):
    """Return a region without components below `least` and holes below `hole` pixels."""
    out = region.copy()
    for component in _components(region, diagonal=True):
        if len(component) < least:
            for i, j in component:
                out[i, j] = False
    rows, columns = out.shape
    for component in _components(~out, diagonal=False):
        touches = any(i in (0, rows - 1) or j in (0, columns - 1) for i, j in component)
        if len(component) < hole and not touches:
            for i, j in component:
                out[i, j] = True
    return out


def _components(region, *, diagonal):
    """Return the connected components of a region, a list of pixels each, by flooding."""
    left = {(int(i), int(j)) for i, j in np.argwhere(region)}
    steps = [(di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1) if diagonal or di == 0 or dj == 0]
    found = []
    while left:
        edge = [left.pop()]
        component = list(edge)
        while edge:
            i, j = edge.pop()
            for di, dj in steps:
                if (i + di, j + dj) in left:
                    left.discard((i + di, j + dj))
                    edge.append((i + di, j + dj))
                    component.append((i + di, j + dj))
        found.append(component)
    return found
