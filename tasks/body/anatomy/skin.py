"""What color a performer's skin has, learned from the take itself (digitization paper, 3.4.1).

The paper follows skin-colored regions and does not say what skin color is. Here it is what the
hands and the front of the head show in the first frames and the rest of the body does not: the
ratio of two histograms of colors, over two chromaticities, which a change of light leaves
alone, and a coarse lightness. Hands and face have a table each, and each takes in what it
recognizes of the other; so gloves are as good as bare hands where they differ from the clothes.
How far they do is measured and said: a costume of the color of skin makes a model that knows
that it knows nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio

LEAST_RATIO = 1.0
"""Logarithm of how much likelier a color is on hands or face than elsewhere that is skin."""

NEEDED_JOINTS = ("Head", "Neck", "RShoulder", "LShoulder", "RFin", "LFin")
"""The joints of the initial model that say where skin is; wrists help where they are known."""

_HAND_LENGTH = 0.108
"""From wrist to fingertip, in statures (Drillis and Contini 1966)."""


@dataclass(frozen=True, eq=False)
class SurfaceFrame:
    """The colored surface voxels of one frame."""

    center: NDArray[np.float64]
    """(surface voxel, 3) metres."""

    color: NDArray[np.uint8]
    """(surface voxel, 3) RGB."""

    camera: NDArray[np.uint8]
    """(surface voxel,) the camera of the color; 255 where it is not the voxel's own."""


@dataclass(frozen=True)
class SkinSettings:
    """Everything that changes a model of skin color."""

    hand_begins: float = 0.25
    """Share of the way from wrist to fingertips where the hand begins: cuffs end before."""

    hand_radius: float = 0.04
    """Distance from that line within which a voxel is the hand's, in statures: 7 cm of 1.7 m, a
    hand seen by few cameras is half as thick again as it is."""

    head_radius: float = 0.08
    """Distance from the line through neck and head within which a voxel is the head's, in
    statures; a head of 1.7 m is 20 cm deep."""

    most: float = 4.0
    """Largest logarithm of the ratio: a color seen on hands only is 55 times likelier there."""

    few: float = 0.2
    """Voxels of both hands, as a share of the face's, below which they are believed the less:
    the hull has lost them. Of twelve generated takes ten have 0.5 to 1.6, and two that lost
    the hands 0 to 0.02."""

    useless: float = 0.4
    """Hands told from clothes by less than this share of how well the face is are taken to
    have the face's color; but that is only a guess, and believed by this share of it."""

    least: float = -3.0
    """Smallest logarithm of the ratio."""


@dataclass(frozen=True, eq=False)
class SkinModel:
    """How much likelier each color is on hands, and on the face, than elsewhere."""

    hand: NDArray[np.float32]
    """(64, 64, 64) logarithm of the likelihood ratio, by the upper six bits of R, G and B."""

    face: NDArray[np.float32]
    """(64, 64, 64) the same for the face."""

    hand_separability: float
    """Share of the hands' voxels that are recognized less that of other voxels; 0: the color
    says nothing, 1: all."""

    face_separability: float
    """The same for the face."""


def learn_skin(
    frames: Sequence[SurfaceFrame],
    joints: Mapping[str, NDArray[np.float64]],
    stature_m: float,
    settings: SkinSettings | None = None,
) -> SkinModel:
    """Return what color hands and face have.

    Parameters
    ----------
    frames
        In which the performer stands as the joints say: the frame of the initial model, and
        frames near it while the arms are held.
    joints : mapping of (3,) float64
        Metres; those of `NEEDED_JOINTS`, by the names of the archive.
    stature_m
        The performer's height.
    settings
        Where skin is looked for.

    Raises
    ------
    ValueError
        If there is no frame, a joint is missing or not finite, or the stature is not positive.
    """
    if not frames:
        raise ValueError("skin was to be learned from no frame; give one with an initial model")
    check_joints(joints, stature_m)
    settings = settings or SkinSettings()
    colors = [frame.color[frame.camera != NO_CAMERA] for frame in frames]
    kinds = [
        find_skin_parts(frame.center[frame.camera != NO_CAMERA], joints, stature_m, settings)
        for frame in frames
    ]
    kind, cell = np.concatenate(kinds), color_cells(np.concatenate(colors))
    hand, face, other = (cell[kind == k] for k in (_HAND, _FACE, _OTHER))
    hand_table, hand_known = _learn(hand, face, other, settings)
    face_table, face_known = _learn(face, hand, other, settings)
    steps = np.arange(2, 256, 4, dtype=np.uint8)
    every = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    place = color_cells(every)
    hand_known *= min(1.0, len(hand) / max(settings.few * len(face), 1.0))
    if hand_known < settings.useless * face_known:  # unlike the face, or not in the hull at all
        hand_table, hand_known = face_table, settings.useless * face_known
    size = (64, 64, 64)
    return SkinModel(
        hand_table[place].reshape(size), face_table[place].reshape(size), hand_known, face_known
    )


def skin_ratio(
    model: SkinModel, color: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the logarithms of how much likelier colors (..., 3) are on hands and on the face.

    Where a voxel's color is not its own, the caller takes 0.
    """
    r, g, b = (color[..., channel] >> 2 for channel in range(3))
    return model.hand[r, g, b], model.face[r, g, b]


def is_skin(
    model: SkinModel, color: NDArray[np.uint8], *, least_ratio: float = LEAST_RATIO
) -> NDArray[np.bool_]:
    """Return where colors (..., 3) are skin: e or more times as likely on hands or face.

    A model that cannot tell hands or face from clothes says so by its separability; what it
    calls skin is then worth as little.
    """
    hand, face = skin_ratio(model, color)
    return np.maximum(hand, face) > least_ratio


def check_joints(joints: Mapping[str, NDArray[np.float64]], stature_m: float) -> None:
    """Refuse an initial model without the joints that say where skin is."""
    missing = [n for n in NEEDED_JOINTS if not np.isfinite(joints.get(n, np.nan)).all()]
    if missing:
        raise ValueError(
            f"the initial model has no {', '.join(missing)}; give all of {', '.join(NEEDED_JOINTS)}"
        )
    if not (np.isfinite(stature_m) and stature_m > 0.0):
        raise ValueError(f"stature_m {stature_m} must be positive; give metres")


def find_hands(
    joints: Mapping[str, NDArray[np.float64]], stature_m: float
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return wrist and fingertip, (3,) each, of the right and the left hand.

    A wrist that is not known is a hand's length before the fingertip, toward the shoulder.
    """
    hands = []
    for side in "RL":
        tip = np.asarray(joints[f"{side}Fin"], np.float64)
        wrist = np.asarray(joints.get(f"{side}Wrist", np.full(3, np.nan)), np.float64)
        if not np.isfinite(wrist).all():
            back = np.asarray(joints[f"{side}Shoulder"]) - tip
            length = max(float(np.linalg.norm(back)), 1e-9)
            wrist = tip + _HAND_LENGTH * stature_m * back / length
        hands.append((wrist, tip))
    return hands


_OTHER, _HAND, _FACE, _UNSURE = range(4)


def find_skin_parts(
    center: NDArray[np.float64],
    joints: Mapping[str, NDArray[np.float64]],
    stature_m: float,
    settings: SkinSettings,
) -> NDArray[np.int8]:
    """Return (voxel,) 1 on a hand, 2 on the front of the head, 3 on neither surely, else 0."""
    kind = np.full(len(center), _OTHER, np.int8)
    neck, head = np.asarray(joints["Neck"]), np.asarray(joints["Head"])
    along, away = _along(center, neck, head)
    front = np.cross(np.subtract(joints["LShoulder"], joints["RShoulder"]), head - neck)
    front = front / max(float(np.linalg.norm(front)), 1e-9)
    near = away < settings.head_radius * stature_m
    ahead = (center - neck) @ front - along * float((head - neck) @ front)
    kind[near & (along > 0.1) & (along < 1.2)] = _UNSURE
    kind[near & (along > 0.35) & (along < 1.05) & (ahead < -0.02 * stature_m)] = _OTHER
    kind[near & (along > 0.35) & (along < 0.85) & (ahead > 0.02 * stature_m)] = _FACE
    for wrist, tip in find_hands(joints, stature_m):
        along, away = _along(center, wrist, tip)
        near = away < settings.hand_radius * stature_m
        kind[near & (along > -0.25) & (along < 1.5)] = _UNSURE
        kind[near & (along > settings.hand_begins) & (along < 1.25)] = _HAND
    return kind


def _along(
    center: NDArray[np.float64], begin: NDArray[np.float64], end: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the share of the way from begin to end of each point, and its distance from it."""
    way = end - begin
    along = (center - begin) @ way / max(float(way @ way), 1e-9)
    return along, np.linalg.norm(center - begin - along[:, None] * way, axis=1)


def _ratio(
    own: NDArray[np.float64], other: NDArray[np.float64], settings: SkinSettings
) -> NDArray[np.float32]:
    """Return the logarithm of the ratio of two distributions, between its limits."""
    ratio = log_ratio(own, other)
    return np.clip(ratio, settings.least, settings.most).astype(np.float32)


def _learn(
    own: NDArray[np.intp], lent: NDArray[np.intp], other: NDArray[np.intp], settings: SkinSettings
) -> tuple[NDArray[np.float32], float]:
    """Return the ratio of each cell, and how well it tells own colors from others.

    What the other skin, `lent`, shares with one's own is taken in.
    """
    counts, others = count_colors(own), count_colors(other)
    alike = _ratio(counts, others, settings)[lent] > 0.0
    ratio = _ratio(counts + count_colors(lent[alike]), others, settings)
    return ratio, separability(ratio, own, other)


def separability(
    ratio: NDArray[np.floating],
    own: NDArray[np.intp],
    other: NDArray[np.intp],
    *,
    least: float = 1.0,
) -> float:
    """Return the share of own colors that are recognized less that of others.

    Parameters
    ----------
    ratio : (cell,) float
        Logarithm of how much likelier a color is one's own.
    own, other : (color,) int
        Cells of colors.
    least
        Ratio from which a color is recognized.
    """
    if not len(own):
        return 0.0
    known = np.mean(ratio[own] > least)
    mistaken = np.mean(ratio[other] > least) if len(other) else 0.0
    return float(np.clip(known - mistaken, 0.0, 1.0))
