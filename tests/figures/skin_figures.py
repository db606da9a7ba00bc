"""A dancer of points, for tests: trunk, head with a face in front, arms, hands, a sash."""

import numpy as np

from tasks.body.anatomy.skin import LEAST_RATIO, SurfaceFrame

SKIN, CLOTH, HAIR, GOLD, GLOVE = (
    (222, 176, 142),
    (60, 80, 160),
    (35, 28, 30),
    (214, 180, 70),
    (200, 40, 60),
)
STATURE_M = 1.6
JOINTS = {
    "Head": np.array([0.0, 1.60, 0.0]),
    "Neck": np.array([0.0, 1.36, 0.0]),
    "RShoulder": np.array([-0.18, 1.32, 0.0]),
    "LShoulder": np.array([0.18, 1.32, 0.0]),
    "RWrist": np.array([-0.66, 1.32, 0.0]),
    "LWrist": np.array([0.66, 1.32, 0.0]),
    "RFin": np.array([-0.83, 1.32, 0.0]),
    "LFin": np.array([0.83, 1.32, 0.0]),
}
"""Stretched arms; the performer looks along +z, the left hand is at +x."""

STRETCHED = np.array([[-0.745, 1.32, 0.0], [0.745, 1.32, 0.0]])
"""The middles of the right and the left hand then."""


def ball(center, radii, color, *, step=0.02):
    """Return points on an ellipsoid, about `step` apart, in one color."""
    radii = np.asarray(radii)
    count = int(4 * np.pi * np.mean(radii) ** 2 / step**2)
    k = np.arange(count) + 0.5
    up, turn = 1 - 2 * k / count, k * np.pi * (1 + 5**0.5)
    flat = np.sqrt(1 - up**2)
    unit = np.stack([flat * np.cos(turn), up, flat * np.sin(turn)], axis=1)
    return center + unit * radii, np.tile(np.uint8(color), (count, 1))


def rod(begin, end, radius, color, *, step=0.02):
    """Return points on a tube."""
    begin, end = np.asarray(begin), np.asarray(end)
    way = (end - begin) / max(float(np.linalg.norm(end - begin)), 1e-9)
    side = np.cross(way, [0.12, 0.31, 0.94])
    side /= np.linalg.norm(side)
    other = np.cross(way, side)
    along = np.arange(0.0, np.linalg.norm(end - begin), step)
    turn = np.arange(0, 2 * np.pi, step / radius)
    ring = radius * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other)
    points = (begin + along[:, None] * way)[:, None] + ring
    return points.reshape(-1, 3), np.tile(np.uint8(color), (points.shape[0] * len(ring), 1))


def dancer(hands, rng, *, hand=SKIN, cloth=CLOTH, sash=None, shown=(True, True)):
    """Return the colored surface of a dancer whose hands are at two places; arms are straight."""
    parts = [
        ball([0.0, 1.08, 0.0], [0.17, 0.28, 0.11], cloth),
        ball([0.0, 0.45, 0.0], [0.14, 0.45, 0.11], cloth),
        rod(JOINTS["Neck"], [0.0, 1.40, 0.0], 0.05, SKIN),
    ]
    if sash is not None:
        parts.append(rod([0.0, 0.98, 0.0], [0.0, 1.06, 0.0], 0.17, sash))
    place, color = ball([0.0, 1.49, 0.0], [0.075, 0.11, 0.09], HAIR)
    color[(place[:, 2] > 0.025) & (place[:, 1] < 1.56)] = SKIN
    parts.append((place, color))
    for side in range(2):
        shoulder = JOINTS["RL"[side] + "Shoulder"]
        arm = np.subtract(hands[side], shoulder)
        parts.append(rod(shoulder, hands[side] - 0.07 * arm / np.linalg.norm(arm), 0.04, cloth))
        if shown[side]:
            parts.append(ball(hands[side], [0.07, 0.05, 0.05], hand))
    place = np.concatenate([p for p, _ in parts])
    color = np.concatenate([c for _, c in parts]).astype(float)
    color = color * rng.uniform(0.8, 1.0, (len(color), 1)) + rng.normal(0, 3, color.shape)
    camera = np.where(rng.random(len(place)) < 0.02, 255, 3).astype(np.uint8)
    return SurfaceFrame(place, np.clip(color, 0, 255).astype(np.uint8), camera)


def skin_ratio(model, color):
    """Return the logarithms of how much likelier colors (..., 3) are on hands, and on the face."""
    r, g, b = (color[..., channel] >> 2 for channel in range(3))
    return model.hand[r, g, b], model.face[r, g, b]


def is_skin(model, color):
    """Return where colors (..., 3) are skin."""
    return np.maximum(*skin_ratio(model, color)) > LEAST_RATIO
