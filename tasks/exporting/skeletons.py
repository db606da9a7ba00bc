"""Fit a skeleton of constant bones to a joint track, for formats that know only rotations.

The root is the middle of the hips; every other joint hangs at a constant distance from the one
before it and is aimed at, from where the fit before it ended, so that errors do not add up.
Where a body has more joints than a track (the spine between waist and neck, the collar bones, the
skull, the palm, the toes), one more bone of constant length stands in for them, and the two
together reach whatever distance the track has. Where several joints hang on one, each but the
first has a bone of no length to turn it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

TOLERANCE_M = 0.0005
"""A distance that changes by no more than this is one bone."""

ROOT = "Hips"

_PARENT = {
    "Waist": ROOT,
    "Neck": "Waist",
    "Head": "Neck",
    **{f"{side}{joint}": f"{side}{parent}" if parent not in (ROOT, "Neck") else parent
       for side in "RL"
       for joint, parent in (("Shoulder", "Neck"), ("Elbow", "Shoulder"), ("Wrist", "Elbow"),
                             ("Fin", "Wrist"), ("Knee", "Hip"), ("Ankle", "Knee"),
                             ("Foot", "Ankle"), ("Heel", "Ankle"))},
}  # fmt: skip
_MIDDLE = {
    "Waist": "Pelvis",
    "Neck": "Spine",
    "Head": "Skull",
    **{f"{side}{joint}": f"{side}{name}"
       for side in "RL"
       for joint, name in (("Shoulder", "Collar"), ("Fin", "Palm"), ("Foot", "Toes"))},
}  # fmt: skip
_DOWN, _UP, _FORWARD = (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
"""Directions of a skeleton at rest. Y is up, and the performer looks along Z."""
_REST = {"Knee": _DOWN, "Ankle": _DOWN, "Foot": _FORWARD, "Heel": (0.0, 0.0, -1.0)}
"""The direction at rest of the bone that ends at a joint. A standing leg, with its foot flat."""


@dataclass(frozen=True)
class Skeleton:
    """Bones of constant length and how they move; lengths in metres."""

    names: tuple[str, ...]
    """A joint's own name, or that of a bone that stands in for joints the track lacks."""
    parents: tuple[int, ...]
    """The index of each bone's parent, which stands before it; -1 for the root."""
    offset: NDArray[np.float64]
    """(bone, 3): where a bone begins in its parent's axes; at rest the arms are stretched."""
    root_position: NDArray[np.float64]
    """(time, 3)."""
    rotation: NDArray[np.float64]
    """(time, bone, 3, 3), in the parent's axes."""


@dataclass(frozen=True)
class FitError:
    """How far the joints of a skeleton are from those of its track, where the track has them."""

    mean_m: float
    """Mean over joints and frames."""
    p95_m: float
    """The distance that 95 % of them stay within."""
    max_m: float
    """The largest."""


@dataclass
class _Growing:
    """A skeleton while bones are added to it, in the axes of the world."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offset: list[NDArray[np.float64]] = field(default_factory=list)
    position: list[NDArray[np.float64]] = field(default_factory=list)
    rotation: list[NDArray[np.float64]] = field(default_factory=list)


def fit_skeleton(
    position: NDArray[np.floating], joints: Sequence[str]
) -> tuple[Skeleton, FitError]:
    """Return a skeleton of constant bones that follows a joint track, and how far it is off.

    Parameters
    ----------
    position : (time, joint, 3) float
        Metres, y up; NaN where missing. A joint that is never there has no bone; in a gap the
        others are followed and the joint moves evenly in relation to the hips.
    joints : sequence of str
        The names of the joints as in the archive; both hips have to be among them.

    Returns
    -------
    Skeleton, FitError

    Raises
    ------
    ValueError
        Shapes do not agree, a joint is not one of the archive's, or a hip is never there.
    """
    position = np.asarray(position, np.float64)
    if position.ndim != 3 or position.shape[1:] != (len(joints), 3):
        raise ValueError(
            f"position is {position.shape}, (time, {len(joints)}, 3) is wanted: one place for "
            "each joint"
        )
    unknown = sorted(set(joints) - {*_PARENT, "RHip", "LHip"})
    if unknown:
        raise ValueError(f"{unknown} are no joints of the archive; leave them out")
    there = np.all(np.isfinite(position), axis=-1)
    seen = {name: there[:, n] for n, name in enumerate(joints) if there[:, n].any()}
    if not {"RHip", "LHip"} <= set(seen):
        raise ValueError("a skeleton hangs on both hips, and one is never there; add it")
    track = _without_gaps({name: position[:, list(joints).index(name)] for name in seen}, seen)
    growing = _Growing()
    _add_pelvis(growing, track, seen)
    for joint in _PARENT:
        if joint in track and joint not in growing.names:
            _add_joint(growing, joint, track[joint], seen[joint])
    skeleton = _finished(growing)
    return skeleton, _error(skeleton, position, joints)


def skeleton_positions(skeleton: Skeleton) -> NDArray[np.float64]:
    """Return where each bone begins, (time, bone, 3), metres: forward kinematics."""
    position = np.empty((*skeleton.rotation.shape[:2], 3))
    turned: list[NDArray[np.float64]] = []
    for bone, parent in enumerate(skeleton.parents):
        rotation = skeleton.rotation[:, bone]
        if parent < 0:
            position[:, bone] = skeleton.root_position
            turned.append(rotation)
        else:
            position[:, bone] = position[:, parent] + turned[parent] @ skeleton.offset[bone]
            turned.append(turned[parent] @ rotation)
    return position


def _without_gaps(
    track: dict[str, NDArray[np.float64]], seen: dict[str, NDArray[np.bool_]]
) -> dict[str, NDArray[np.float64]]:
    """Return the track with its gaps crossed in a straight line, in relation to the hips."""
    right, left = (_crossed(track[hip], seen[hip]) for hip in ("RHip", "LHip"))
    middle = (right + left) / 2
    return {name: middle + _crossed(track[name] - middle, seen[name]) for name in track}


def _crossed(values: NDArray[np.float64], seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return (time, 3) values with straight lines where they were not seen."""
    frames = np.arange(len(values))
    lines = [np.interp(frames, frames[seen], column) for column in values[seen].T]
    return np.stack(lines, axis=1)


def _add_pelvis(
    growing: _Growing,
    track: dict[str, NDArray[np.float64]],
    seen: dict[str, NDArray[np.bool_]],
) -> None:
    """Add the root, turned with hips and waist, and what is rigid to it."""
    middle = (track["RHip"] + track["LHip"]) / 2
    across = _unit_or(track["LHip"] - track["RHip"], (1.0, 0.0, 0.0))
    upward = np.tile(_UP, (len(middle), 1))
    for joint in ("Waist", "Neck", "Head", "RShoulder", "LShoulder"):
        if joint in track:
            toward = _across(track[joint] - middle, across)
            if np.median(np.linalg.norm(toward, axis=1)) > 0.01:
                upward = toward
                break
    upward = _unit_or(_across(upward, across), _UP)
    rotation = np.stack([across, upward, np.cross(across, upward)], axis=-1)
    growing.names.append(ROOT)
    growing.parents.append(-1)
    growing.offset.append(np.zeros(3))
    growing.position.append(middle)
    growing.rotation.append(rotation)
    for joint in ("RHip", "LHip", "Waist"):
        if joint in track:
            local = np.einsum("tji,tj->ti", rotation, track[joint] - middle)[seen[joint]]
            offset = np.median(local, axis=0)
            rigid = np.linalg.norm(local - offset, axis=1).max() <= TOLERANCE_M
            if rigid or joint != "Waist":
                _add_bone(growing, joint, 0, offset)


def _add_joint(
    growing: _Growing, joint: str, target: NDArray[np.float64], seen: NDArray[np.bool_]
) -> None:
    """Add the bone, or the two bones, from the nearest joint before this one to it."""
    above = _PARENT[joint]
    while above not in growing.names:
        above = _PARENT[above]
    parent = growing.names.index(above)
    if parent == 0 or parent in growing.parents:
        parent = _add_bone(growing, f"{joint}Base", parent, np.zeros(3))
    away = np.linalg.norm(target - growing.position[parent], axis=1)
    length = float(np.median(away[seen]))
    constant = np.abs(away[seen] - length).max() <= TOLERANCE_M
    direction = _rest_direction(joint)
    if constant or (above == _PARENT[joint] and joint not in _MIDDLE):
        _aim(growing, parent, direction, target)
        _add_bone(growing, joint, parent, direction * length)
        return
    # A frame that is off must not make the bones of all the others long.
    half = min(float(away[seen].max()), 1.5 * length) / 2
    name = _MIDDLE.get(joint, f"{joint}Middle")
    _aim(growing, parent, direction, _bend(growing, parent, target, half))
    middle = _add_bone(growing, name, parent, direction * half)
    _aim(growing, middle, direction, target)
    _add_bone(growing, joint, middle, direction * half)


def _rest_direction(joint: str) -> NDArray[np.float64]:
    """Return where a bone points at rest: the arms stretched, the feet forward."""
    if joint[1:] in ("Shoulder", "Elbow", "Wrist", "Fin"):
        return np.array([-1.0 if joint[0] == "R" else 1.0, 0.0, 0.0])
    return np.array(_REST.get(joint[1:], _UP))


def _bend(
    growing: _Growing, bone: int, target: NDArray[np.float64], half: float
) -> NDArray[np.float64]:
    """Return the middle of two bones of a half each that reach from a bone to the target."""
    begin, root = growing.position[bone], growing.rotation[0]
    along = _unit_or(target - begin, _UP)
    reach = np.minimum(np.linalg.norm(target - begin, axis=1), 2 * half)[:, None] / 2
    side = _across(-root[:, :, 2], along)
    flat = np.linalg.norm(side, axis=1, keepdims=True) < 0.05
    side = _unit_or(np.where(flat, _across(root[:, :, 1], along), side), _FORWARD)
    return begin + along * reach + side * np.sqrt(np.maximum(half**2 - reach**2, 0.0))


def _add_bone(growing: _Growing, name: str, parent: int, offset: NDArray[np.float64]) -> int:
    """Add a bone that turns with its parent until it is aimed; return its index."""
    growing.names.append(name)
    growing.parents.append(parent)
    growing.offset.append(offset)
    growing.position.append(growing.position[parent] + growing.rotation[parent] @ offset)
    growing.rotation.append(growing.rotation[parent])
    return len(growing.names) - 1


def _aim(
    growing: _Growing, bone: int, direction: NDArray[np.float64], target: NDArray[np.float64]
) -> None:
    """Turn a bone by the shortest way until a direction of its own points to the target."""
    now = growing.rotation[bone] @ direction
    to = target - growing.position[bone]
    length = np.linalg.norm(to, axis=1, keepdims=True)
    to = np.where(length > 1e-9, to / np.maximum(length, 1e-9), now)
    growing.rotation[bone] = _swing(now, to) @ growing.rotation[bone]


def _swing(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotations (time, 3, 3) of unit vectors a to b."""
    # Two reflections: in the plane across a, then in the plane across a + b (Householder).
    half = a + b
    opposite = np.linalg.norm(half, axis=1, keepdims=True) < 1e-6
    least = np.eye(3)[np.argmin(np.abs(a), axis=1)]
    half = _unit_or(np.where(opposite, _across(least, a), half), _UP)
    first = np.eye(3) - 2 * a[:, :, None] * a[:, None, :]
    second = np.eye(3) - 2 * half[:, :, None] * half[:, None, :]
    return second @ first


def _across(vector: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of (time, 3) vectors at right angles to unit axes."""
    return vector - axis * np.sum(vector * axis, axis=1, keepdims=True)


def _unit_or(vector: NDArray[np.float64], instead: Sequence[float]) -> NDArray[np.float64]:
    """Return (time, 3) vectors at length 1, and another one where there is no direction."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.where(length > 1e-9, vector / np.maximum(length, 1e-9), np.array(instead))


def _finished(growing: _Growing) -> Skeleton:
    """Return the skeleton with each rotation in its parent's axes."""
    local = [
        rotation if parent < 0 else growing.rotation[parent].transpose(0, 2, 1) @ rotation
        for parent, rotation in zip(growing.parents, growing.rotation, strict=True)
    ]
    return Skeleton(
        tuple(growing.names),
        tuple(growing.parents),
        np.array(growing.offset),
        growing.position[0],
        np.stack(local, axis=1),
    )


def _error(skeleton: Skeleton, position: NDArray[np.float64], joints: Sequence[str]) -> FitError:
    """Return how far the skeleton is from the track where the track has its joints."""
    fitted = skeleton_positions(skeleton)
    both = [(n, skeleton.names.index(j)) for n, j in enumerate(joints) if j in skeleton.names]
    ours, theirs = zip(*both, strict=True)
    away = np.linalg.norm(position[:, list(ours)] - fitted[:, list(theirs)], axis=-1)
    away = away[np.isfinite(away)]
    return FitError(float(away.mean()), float(np.percentile(away, 95)), float(away.max()))
