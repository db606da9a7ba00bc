"""What color a performer's skin has, learned from the take itself (digitization paper, 3.4.1).

The paper follows skin-colored regions and does not say what skin color is. Here a color is skin as
far as the hands and the front of the head show it in the first frames and the rest of the body does
not. Two histograms of colors tell how far: their ratio, over two chromaticities, which a change of
light leaves alone, and a coarse lightness. Hands and face have a table each, and each table takes
in what it recognizes of the other; so gloves are as good as bare hands where they differ from the
clothes. The model says how far they do: a costume of the color of skin makes a model that knows
that it knows nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from storage.schema import NO_CAMERA
from tasks.body.anatomy.colors import color_cells, count_colors, log_ratio
from tasks.body.anatomy.proportions import HAND_LENGTH
from tasks.engine.settings import Finite, Positive, Share, check_ranges

LEAST_RATIO = 1.0
"""Logarithm of how much likelier than elsewhere a color must be on hands or face to be skin
[nats]. Such a color is e times as likely there; chosen by eye on the shared captures, not
measured."""

SKIN_JOINTS = ("Head", "Neck", "RShoulder", "LShoulder", "RFin", "LFin")
"""The joints of the initial model that say where skin is; wrists help where they are known."""

HEAD_SPAN = (0.1, 1.2)
"""Between which places a voxel near the head may be the head's [shares of the way from neck to
head]. Chosen by eye on the shared captures; not measured."""

HAIR_SPAN = (0.35, 1.05)
"""Between which places the back of the head is surely no face [shares of the way from neck to
head]. Chosen by eye on the shared captures; not measured."""

FACE_SPAN = (0.35, 0.85)
"""Between which places the front of the head is surely the face [shares of the way from neck to
head]. Chosen by eye on the shared captures; not measured."""

FACE_DEPTH = 0.02
"""How far before and behind the line from neck to head its front and its back begin [statures].
Chosen by eye on the shared captures; not measured."""

HAND_SPAN = (-0.25, 1.5)
"""Between which places a voxel near the hand may be the hand's [shares of the way from wrist to
finger tip]. Chosen by eye on the shared captures; not measured."""

HAND_ENDS = 1.25
"""Where a hand surely ends [share of the way from wrist to finger tip]. Hulls are longer than
hands; chosen by eye on the shared captures, not measured."""


_OTHER, _HAND, _FACE, _UNSURE = range(4)
"""What a voxel shows; see `find_skin_parts`."""


@dataclass(frozen=True, eq=False)
class SurfaceFrame:
    """The colored surface voxels of one frame."""

    center: NDArray[np.float64]
    """(surface voxel, 3) metres."""

    color: NDArray[np.uint8]
    """(surface voxel, 3) RGB."""

    camera: NDArray[np.uint8]
    """(surface voxel,) the camera that saw the color; `NO_CAMERA` where it is not the voxel's
    own."""


@dataclass(frozen=True)
class SkinSettings:
    """Everything that changes a model of skin color.

    Raises
    ------
    ValueError
        If a number is not finite or out of its range.
    """

    hand_begins: Share = 0.25
    """Where the hand begins, as a share of the way from wrist to finger tip. Cuffs end before."""

    hand_radius: Positive = 0.04
    """How far from the line from wrist to finger tip a voxel of the hand is at most [statures].
    7 cm of 1.7 m: a hand seen by few cameras is half as thick again as it is."""

    head_radius: Positive = 0.08
    """How far from the line through neck and head a voxel of the head is at most [statures]. A
    head of 1.7 m is 20 cm deep."""

    most: Positive = 4.0
    """Largest logarithm of how much likelier a color is on skin [nats]. A color seen on hands only
    is 55 times likelier there."""

    few: Positive = 0.2
    """Voxels of both hands below which they are believed the less [as of the face]. The hull has
    lost such hands. Of twelve generated takes ten have 0.5 to 1.6, and two that lost the hands 0 to
    0.02."""

    useless: Share = 0.4
    """How well hands are told from clothes, as a share of how well the face is, below which they
    are taken to have the face's color. That is only a guess, and believed by this share of it.
    Chosen by eye on the shared captures; not measured."""

    least: Finite = -3.0
    """Smallest logarithm of how much likelier a color is on skin [nats]. Chosen by eye on the
    shared captures; not measured."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, eq=False)
class SkinModel:
    """How much likelier each color is on hands, and on the face, than elsewhere."""

    hand: NDArray[np.float32]
    """(64, 64, 64) logarithm of the likelihood ratio, by the upper six bits of R, G and B."""

    face: NDArray[np.float32]
    """(64, 64, 64) the same for the face."""

    hand_separability: float
    """Share of the hands' voxels that are recognized less that of other voxels. Of 0 the color says
    nothing, of 1 all."""

    face_separability: float
    """The same for the face."""


def learn_skin(
    frames: Sequence[SurfaceFrame],
    joints: Mapping[str, NDArray[np.float64]],
    stature_m: float,
    settings: SkinSettings,
) -> SkinModel:
    """Return what color hands and face have.

    Parameters
    ----------
    frames
        In which the performer stands as the joints say: the frame of the initial model, and
        frames near it while the arms are held.
    joints : mapping of (3,) float64
        Metres, by the names of the archive; at least those of `SKIN_JOINTS`.
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


def check_joints(joints: Mapping[str, NDArray[np.float64]], stature_m: float) -> None:
    """Refuse an initial model without the joints that say where skin is."""
    missing = [n for n in SKIN_JOINTS if not np.isfinite(joints.get(n, np.nan)).all()]
    if missing:
        raise ValueError(
            f"the initial model has no {', '.join(missing)}; give all of {', '.join(SKIN_JOINTS)}"
        )
    if not (np.isfinite(stature_m) and stature_m > 0.0):
        raise ValueError(f"stature_m {stature_m} must be positive; give metres")


def find_hands(
    joints: Mapping[str, NDArray[np.float64]], stature_m: float
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return wrist and finger tip, (3,) each, of the right and the left hand.

    A wrist that is not known is a hand's length before the fingertip, toward the shoulder.
    """
    hands = []
    for side in "RL":
        tip = np.asarray(joints[f"{side}Fin"], np.float64)
        wrist = np.asarray(joints.get(f"{side}Wrist", np.full(3, np.nan)), np.float64)
        if not np.isfinite(wrist).all():
            back = np.asarray(joints[f"{side}Shoulder"]) - tip
            length = max(float(np.linalg.norm(back)), 1e-9)
            wrist = tip + HAND_LENGTH * stature_m * back / length
        hands.append((wrist, tip))
    return hands


def find_skin_parts(
    center: NDArray[np.float64],
    joints: Mapping[str, NDArray[np.float64]],
    stature_m: float,
    settings: SkinSettings,
) -> NDArray[np.int8]:
    """Return (voxel,) 1 for a hand, 2 for the front of the head, 3 for neither surely, else 0."""
    kind = np.full(len(center), _OTHER, np.int8)
    neck, head = np.asarray(joints["Neck"]), np.asarray(joints["Head"])
    along, away = _along(center, neck, head)
    front = np.cross(np.subtract(joints["LShoulder"], joints["RShoulder"]), head - neck)
    front = front / max(float(np.linalg.norm(front)), 1e-9)
    near = away < settings.head_radius * stature_m
    ahead = (center - neck) @ front - along * float((head - neck) @ front)
    kind[near & _is_between(along, HEAD_SPAN)] = _UNSURE
    kind[near & _is_between(along, HAIR_SPAN) & (ahead < -FACE_DEPTH * stature_m)] = _OTHER
    kind[near & _is_between(along, FACE_SPAN) & (ahead > FACE_DEPTH * stature_m)] = _FACE
    for wrist, tip in find_hands(joints, stature_m):
        along, away = _along(center, wrist, tip)
        near = away < settings.hand_radius * stature_m
        kind[near & _is_between(along, HAND_SPAN)] = _UNSURE
        kind[near & _is_between(along, (settings.hand_begins, HAND_ENDS))] = _HAND
    return kind


def _is_between(along: NDArray[np.float64], span: tuple[float, float]) -> NDArray[np.bool_]:
    """Return where shares are between two others."""
    return (along > span[0]) & (along < span[1])


def _along(
    center: NDArray[np.float64], begin: NDArray[np.float64], end: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far along the way from begin to end each point is, a share, and how far off it."""
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

    `lent` are the colors of the other skin. Those that are like one's own are taken in.
    """
    counts, others = count_colors(own), count_colors(other)
    alike = _ratio(counts, others, settings)[lent] > 0.0
    ratio = _ratio(counts + count_colors(lent[alike]), others, settings)
    return ratio, separability(ratio, own, other, least=LEAST_RATIO)


def separability(
    ratio: NDArray[np.floating],
    own: NDArray[np.intp],
    other: NDArray[np.intp],
    *,
    least: float,
) -> float:
    """Return the share of own colors that are recognized, less the share of others that are.

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
