"""What hangs from a kimono: the skirt around both legs, and the sleeves."""

from collections.abc import Mapping

import numpy as np

from storage.schema import SEGMENTS
from tasks.studio.dancing.limbs import unit
from tasks.studio.stage.tubes import Color, Track, Tube, close_tube

Colors = tuple[Color, Color]


def hang_skirt(joints: Mapping[str, Track], hip_left: Track, scale: float, colors: Colors) -> Tube:
    """Return the skirt of a kimono: rings around both legs, from the waist to above the ankles.

    Each point of a ring keeps its distance from the leg that is farther out in its direction,
    so the cloth spans what is between the legs.
    """
    level = np.linspace(0.0, 0.94, 30)
    legs = [
        np.stack(
            [
                joints["Waist"] + outward * 0.03 * scale * hip_left,
                *(joints[side + name] for name in ("Hip", "Knee", "Ankle")),
            ],
            axis=1,
        )
        for side, outward in (("R", -1.0), ("L", 1.0))
    ]
    right, left = (_along_chain(leg, np.array([0.0, 0.18, 0.58, 1.0]), level) for leg in legs)
    angle = 2.0 * np.pi * np.arange(40) / 40
    level_left = unit(hip_left * [1.0, 0.0, 1.0])
    level_front = np.cross(level_left, [0.0, 1.0, 0.0])
    outward = (
        np.cos(angle)[:, None] * level_left[:, None] + np.sin(angle)[:, None] * level_front[:, None]
    )
    apart = np.einsum("tsk,tak->tsa", left - right, outward)
    share_left = 1.0 / (1.0 + np.exp(-30.0 * apart / scale))
    radius = np.interp(level, [0.0, 0.18, 0.58, 0.94], [0.125, 0.128, 0.100, 0.112])
    folds = 1.0 + 0.05 * level[:, None] * np.cos(9.0 * angle)
    grid = (
        right[:, :, None]
        + share_left[..., None] * (left - right)[:, :, None]
        + (scale * radius[:, None] * folds)[..., None] * outward[:, None]
    )
    grid[..., 1] = np.maximum(grid[..., 1], 0.01 * scale)
    label = np.where(
        level[:, None] < 0.18,
        SEGMENTS.index("Waist") + 1,
        SEGMENTS.index("RUpperLeg") + 1 + 2 * (np.cos(angle) > 0.0) + (level[:, None] > 0.58),
    )
    return close_tube(grid[:, ::-1], label[::-1], colors)  # from the hem up, as rings turn


def _along_chain(points: Track, shares: Track, level: Track) -> Track:
    """Return (time, level, 3) points along a chain (time, point, 3) with a share a point."""
    after = np.clip(np.searchsorted(shares, level, side="right"), 1, len(shares) - 1)
    part = ((level - shares[after - 1]) / (shares[after] - shares[after - 1]))[:, None]
    return (1.0 - part) * points[:, after - 1] + part * points[:, after]


def hang_sleeve(
    joints: Mapping[str, Track],
    front: Track,
    scale: float,
    side: str,
    colors: Colors,
    *,
    from_wrist: bool = False,
) -> Tube:
    """Return a sleeve: a flat bag that hangs from the arm, backward where the arm hangs.

    It hangs from the middle of the forearm, or from the wrist, where it is narrower.
    """
    elbow, wrist = joints[f"{side}Elbow"], joints[f"{side}Wrist"]
    arm = wrist - elbow
    along = unit(arm)
    fall = np.array([0.0, -1.0, 0.0]) + 0.7 * along[:, [1]] * along - 0.3 * front
    fall = unit(fall)
    thick = unit(np.cross(along, fall))
    down = np.linspace(-0.05, 0.46, 18)
    half = np.interp(down, [-0.05, -0.02, 0.4, 0.46], [0.30, 0.56, 0.60, 0.52])
    half = 0.5 * half if from_wrist else half
    deep = np.interp(down, [-0.05, 0.0, 0.08, 0.46], [0.02, 0.058, 0.03, 0.018])
    angle = 2.0 * np.pi * np.arange(36) / 36
    across, aside = (np.sign(x) * abs(x) ** 0.5 for x in (np.cos(angle), np.sin(angle)))
    middle = elbow + (0.72 if from_wrist else 0.36) * arm
    grid = (
        middle[:, None, None]
        + scale * down[:, None, None] * fall[:, None, None]
        + (half[:, None] * across)[..., None] * arm[:, None, None]
        + scale * (deep[:, None] * aside)[..., None] * thick[:, None, None]
    )
    grid[..., 1] = np.maximum(grid[..., 1], 0.01 * scale)
    label = np.full(grid.shape[1:3], SEGMENTS.index(f"{side}ForeArm") + 1)
    return close_tube(grid, label, colors)
