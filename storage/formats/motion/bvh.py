"""Read the bones of BVH files by forward kinematics, and write a skeleton as such a file.

After Meredith and Maddock, "Motion Capture File Formats Explained" (2001), which adds a bone's
position channels to its offset. Many programs write the whole position there instead, with the
offset in it; a bone whose channels stay at its offset is read so, and that is noted.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.errors import InputError
from storage.files import write_beside
from storage.formats import reading
from storage.formats.encodings import UTF_16_MARKS
from storage.formats.motion import writing
from storage.formats.motion.bvh_numbers import read_numbers
from storage.formats.motion.motion_file import MotionFile

_WANTED = "a BVH file"
_CHANNELS = {f"{axis}{kind}": (kind, n) for kind in ("position", "rotation", "scale")
             for n, axis in enumerate("xyz")}  # fmt: skip
_MOST_BONES = 5000
_COUNTS = tuple("0123456789")
_MOTION = re.compile(rb"(?:^|(?<=[\r\n]))[ \t]*MOTION[ \t]*(?=[\r\n]|$)", re.I)
_FRAMES_AT_ONCE = 4096
"""How many frames the bones are placed in at a time. Their rotations are three times as large as
their positions; chosen, not measured."""
_SCALE_TOLERANCE = 1e-3
"""How far a scale channel may be from 1. Chosen: a millimetre of a metre, well above rounding."""


@dataclass
class _Bone:
    """A bone or end site of the hierarchy."""

    name: str
    parent: int
    offset: list[float] = field(default_factory=list)
    channels: list[tuple[str, int]] = field(default_factory=list)
    first_channel: int = 0


def read_bvh(path: Path) -> MotionFile:
    """Read where the bones of a BVH file are, frame by frame.

    Parameters
    ----------
    path : Path
        A BVH file; channels in any order, positions on any bone, scales where they are 1.

    Returns
    -------
    MotionFile
        A position for the beginning of each bone and for each end site, which is called
        "<bone> End". The unit is None: BVH does not say it. Up is "y", as the format has it.

    Raises
    ------
    InputError
        No BVH file, no bones, no frames, fewer numbers than the header tells, bones that change
        their size, damaged.
    """
    path = Path(path)
    data = reading.read_bytes(path, _WANTED)
    if data.startswith(UTF_16_MARKS):
        data = data.decode(reading.checked_encoding(path, data)).encode()
    halves = _MOTION.search(data)
    head = data[: halves.start()] if halves else data
    encoding = reading.checked_encoding(path, head)
    notes = reading.encoding_notes(encoding)
    hierarchy, _ = reading.decode_text(path, head, _WANTED)
    if not re.match(r"\s*HIERARCHY\s", hierarchy, re.I):
        raise InputError(f"{path} does not begin with HIERARCHY; bring {_WANTED}")
    if not halves:
        raise InputError(
            f"{path} has no line MOTION: it is cut short or holds no motion; bring the whole file"
        )
    if not data.endswith((b"\n", b"\r")):
        notes.append("The file does not end with a line end; its last number may be cut.")
    bones = _read_hierarchy(path, hierarchy)
    channels = sum(len(bone.channels) for bone in bones)
    values, rate_hz, more = read_numbers(path, data, halves.end(), channels)
    notes += more
    reading.check_size(path, len(values), len(bones), len(data))
    del data, halves  # the file is as large as its numbers
    notes += _check_scales(path, bones, values)
    position, more = _forward_kinematics(bones, values)
    del values
    notes += more
    kept, again = reading.first_of_each([bone.name for bone in bones])
    position, absurd = reading.without_absurd(position[:, kept] if again else position)
    names = tuple(bones[at].name for at in kept)
    rest = np.zeros((len(bones), 3))
    for at, bone in enumerate(bones):
        rest[at] = bone.offset if bone.parent < 0 else rest[bone.parent] + bone.offset
    notes += [*again, *absurd]
    return MotionFile("bvh", names, position, rate_hz, None, "y", tuple(notes), rest[kept])


def _read_hierarchy(path: Path, text: str) -> list[_Bone]:
    """Return the bones and end sites, parents first."""
    tokens = re.findall(r"[{}]|[^\s{}]+", text)[1:]
    bones: list[_Bone] = []
    open_bones: list[int] = []
    at = channels = 0
    while at < len(tokens):
        word = tokens[at].upper()
        inside = bones[open_bones[-1]] if open_bones else None
        if word in ("ROOT", "JOINT", "END"):
            if "{" not in tokens[at : at + 50] or (inside is None) != (word == "ROOT"):
                raise _damaged(path, f"{word} stands where it cannot")
            brace = tokens.index("{", at)
            name = " ".join(tokens[at + 1 : brace])
            if inside is not None and word == "END":
                name = f"{inside.name} End"
            if not name:
                raise _damaged(path, "a bone has no name")
            bones.append(_Bone(name, open_bones[-1] if open_bones else -1))
            open_bones.append(len(bones) - 1)
            at = brace + 1
        elif word == "}" and open_bones:
            open_bones.pop()
            at += 1
        elif word == "OFFSET" and inside is not None and not inside.offset:
            inside.offset = _offset(path, inside.name, tokens[at + 1 : at + 4])
            at += 4
        elif word == "CHANNELS" and inside is not None and not inside.channels:
            inside.channels = _channels(path, inside.name, tokens[at + 1 : at + 11])
            inside.first_channel = channels
            channels += len(inside.channels)
            at += 2 + len(inside.channels)
        else:
            raise _damaged(path, f"{tokens[at][:40]!r} stands where it cannot")
    if open_bones:
        raise _damaged(path, f"{bones[open_bones[-1]].name!r} is not closed")
    return _checked(path, bones, channels)


def _checked(path: Path, bones: list[_Bone], channels: int) -> list[_Bone]:
    """Return the bones, or say what the hierarchy lacks."""
    if not bones or not channels:
        raise InputError(f"{path} holds no bones that move; export it with its skeleton")
    if len(bones) > _MOST_BONES:
        raise InputError(
            f"{path} holds {len(bones)} bones, where {_MOST_BONES} at most are wanted; export "
            "the body alone"
        )
    without = [bone.name for bone in bones if not bone.offset]
    if without:
        raise _damaged(path, f"{reading.listed(without)} have no OFFSET")
    return bones


def _offset(path: Path, name: str, words: Sequence[str]) -> list[float]:
    """Return the three numbers of an offset."""
    try:
        offset = [float(word) for word in words]
    except ValueError:
        offset = []
    if len(offset) != 3 or not all(abs(value) < reading.FARTHEST for value in offset):
        raise _damaged(path, f"the OFFSET of {name!r} is not three numbers")
    return offset


def _channels(path: Path, name: str, words: Sequence[str]) -> list[tuple[str, int]]:
    """Return kind and axis of a bone's channels, in the order of the file."""
    count = int(words[0]) if words and words[0] in _COUNTS else -1
    told = [word.lower() for word in words[1 : 1 + max(count, 0)]]
    if len(told) != count or len(set(told)) != count or not set(told) <= set(_CHANNELS):
        raise _damaged(
            path,
            f"the CHANNELS of {name!r} are not a number up to 9 and as many of Xposition ... "
            "Zrotation, Zscale",
        )
    return [_CHANNELS[word] for word in told]


def _check_scales(path: Path, bones: Sequence[_Bone], values: NDArray[np.float64]) -> list[str]:
    """Refuse bones that change their size; note scale channels that say nothing."""
    scales = [
        (bone.name, n)
        for bone in bones
        for n, (kind, _) in enumerate(bone.channels, bone.first_channel)
        if kind == "scale"
    ]
    wrong = {
        name: float(column[np.nanargmax(np.abs(column - 1))])
        for name, n in scales
        if np.nanmax(np.abs((column := values[:, n]) - 1), initial=0) > _SCALE_TOLERANCE
    }
    if wrong:
        name, scale = next(iter(wrong.items()))
        raise InputError(
            f"{path} scales {reading.listed(list(wrong))} ({name!r} by {scale:g}), where bones "
            "that keep their size are wanted; export it without scale channels"
        )
    return ["The scale channels are 1 all along: left out."] if scales else []


def _forward_kinematics(
    bones: Sequence[_Bone], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], list[str]]:
    """Return where each bone begins, and a note on channels that held whole positions."""
    position = np.empty((len(values), len(bones), 3))
    whole = [_holds_whole(bone, values) for bone in bones]
    for start in range(0, len(values), _FRAMES_AT_ONCE):
        block = slice(start, start + _FRAMES_AT_ONCE)
        _place_bones(bones, values[block], whole, position[block])
    if not any(whole):
        return position, []
    named = [bone.name for bone, replaced in zip(bones, whole, strict=True) if replaced]
    return position, [
        f"The position channels of {reading.listed(named)} stay at its offset: read as the whole "
        "position, not added to it."
    ]


def _place_bones(
    bones: Sequence[_Bone],
    values: NDArray[np.float64],
    whole: Sequence[bool],
    position: NDArray[np.float64],
) -> None:
    """Write where each bone begins in some frames."""
    rotations: list[NDArray[np.float64]] = []
    with np.errstate(all="ignore"):  # absurd numbers end as missing
        for at, bone in enumerate(bones):
            local = _translation(bone, values, replaced=whole[at])
            rotation = np.zeros((3, 3, len(values)))
            rotation[np.arange(3), np.arange(3)] = 1.0
            if bone.parent >= 0:
                rotation = rotations[bone.parent].copy()
                turned = np.einsum("ijt,tj->ti", rotation, local)
                position[:, at] = position[:, bone.parent] + turned
            else:
                position[:, at] = local
            _rotate(rotation, bone, values)
            rotations.append(rotation)


def _rotate(rotation: NDArray[np.float64], bone: _Bone, values: NDArray[np.float64]) -> None:
    """Turn (3, 3, time) rotations, in place, by a bone's rotation channels in their order."""
    for n, (kind, axis) in enumerate(bone.channels, bone.first_channel):
        if kind == "rotation":
            angle = np.radians(values[:, n])
            cos, sin = np.cos(angle), np.sin(angle)
            first, second = (axis + 1) % 3, (axis + 2) % 3
            a, b = rotation[:, first].copy(), rotation[:, second].copy()
            rotation[:, first] = cos * a + sin * b
            rotation[:, second] = cos * b - sin * a


def _holds_whole(bone: _Bone, values: NDArray[np.float64]) -> bool:
    """Tell whether a bone's position channels hold the whole of its position."""
    # A root travels, so that only its height tells whether the offset is in its channels.
    compared = [(n, axis) for n, axis in _moves(bone) if axis == 1 or bone.parent >= 0]
    if not compared:
        return False
    rest = np.array(bone.offset)[[axis for _, axis in compared]]
    with np.errstate(all="ignore"):
        away = np.median(np.abs(values[:, [n for n, _ in compared]] - rest).sum(axis=1))
    return bool(np.abs(rest).sum() > 0 and away < 0.5 * np.abs(rest).sum())


def _translation(
    bone: _Bone, values: NDArray[np.float64], *, replaced: bool
) -> NDArray[np.float64]:
    """Return where a bone begins in its parent."""
    local = np.tile(np.array(bone.offset), (len(values), 1))
    for n, axis in _moves(bone):
        local[:, axis] = values[:, n] if replaced else local[:, axis] + values[:, n]
    return local


def _moves(bone: _Bone) -> list[tuple[int, int]]:
    """Return column and axis of each of a bone's position channels."""
    columns = enumerate(bone.channels, bone.first_channel)
    return [(n, axis) for n, (kind, axis) in columns if kind == "position"]


def _damaged(path: Path, what: str) -> InputError:
    """Return the error of a hierarchy that cannot be right."""
    return InputError(f"{path} has a damaged hierarchy: {what}; export it again")


def write_bvh(
    path: Path,
    names: Sequence[str],
    parents: Sequence[int],
    offset: NDArray[np.floating],
    root_position: NDArray[np.floating],
    rotation: NDArray[np.floating],
    rate_hz: float,
) -> None:
    """Write a skeleton of constant bones and its motion as a BVH file in centimetres.

    Parameters
    ----------
    path : Path
        Replaced when the whole file has been written.
    names : sequence of str
        A name a bone.
    parents : sequence of int
        The index of each bone's parent, which stands before it; -1 for the root, the first.
    offset : (bone, 3) float
        Where a bone begins in its parent's axes, metres.
    root_position : (time, 3) float
        Metres, y up.
    rotation : (time, bone, 3, 3) float
        Each bone's rotation in its parent's axes; they are written as Zrotation Xrotation
        Yrotation, without jumps.
    rate_hz : float
        Frames a second.

    Raises
    ------
    ValueError
        The arguments do not fit each other or the format.
    OSError
        The file cannot be written; what was there before is still there.
    """
    frames, bones = len(root_position), len(names)
    faults = writing.names_faults(names, "{} \t\r\n")
    shapes = (np.shape(offset), np.shape(root_position), np.shape(rotation), len(parents))
    if shapes != ((bones, 3), (frames, 3), (frames, bones, 3, 3), bones) or not frames:
        faults.append(f"offset, root_position, rotation and parents of {shapes} do not agree")
    elif list(parents[:1]) != [-1] or not all(0 <= p < n for n, p in enumerate(parents) if n):
        faults.append("each parent has to stand before its children, the root first")
    elif not all(np.isfinite(part).all() for part in (offset, root_position, rotation)):
        faults.append("a BVH file cannot hold a gap: fill it first")
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        faults.append(f"rate_hz is {rate_hz}, a positive number is wanted")
    if faults:
        raise ValueError("; ".join(faults))
    order, lines = _hierarchy_lines(names, parents, np.asarray(offset, float) * 100.0)
    angles = np.degrees(_continuous_angles(np.asarray(rotation, float)[:, order]))
    root = np.asarray(root_position, float) * 100.0
    table = np.concatenate([root, angles.reshape(frames, -1)], axis=1)
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1 / rate_hz:.10g}"]
    body = writing.number_lines(table, ["%.6f"] * table.shape[1], " ")
    write_beside(Path(path), ("\n".join(lines) + "\n" + body).encode())


def _hierarchy_lines(
    names: Sequence[str], parents: Sequence[int], offset: NDArray[np.float64]
) -> tuple[list[int], list[str]]:
    """Return the bones in the order of the file, and the lines of its hierarchy."""
    order: list[int] = []
    lines = ["HIERARCHY"]

    def add(bone: int, depth: int) -> None:
        pad = "\t" * depth
        order.append(bone)
        lines.append(f"{pad}{'JOINT' if depth else 'ROOT'} {names[bone]}")
        shift = " ".join(f"{value:.6f}" for value in (offset[bone] if depth else np.zeros(3)))
        channels = "CHANNELS 6 Xposition Yposition Zposition" if not depth else "CHANNELS 3"
        lines.extend([f"{pad}{{", f"{pad}\tOFFSET {shift}"])
        lines.append(f"{pad}\t{channels} Zrotation Xrotation Yrotation")
        children = [child for child, parent in enumerate(parents) if parent == bone]
        for child in children:
            add(child, depth + 1)
        if not children:
            lines.extend([f"{pad}\tEnd Site", f"{pad}\t{{"])
            lines.extend([f"{pad}\t\tOFFSET 0.000000 0.000000 0.000000", f"{pad}\t}}"])
        lines.append(f"{pad}}}")

    add(0, 0)
    return order, lines


def _continuous_angles(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles z, x, y of Rz Rx Ry, (time, bone, 3), nearest to the frame before."""
    x = np.arcsin(np.clip(rotation[..., 2, 1], -1.0, 1.0))
    z = np.arctan2(-rotation[..., 0, 1], rotation[..., 1, 1])
    y = np.arctan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    angles = np.stack([z, x, y], axis=-1)
    other = np.stack([z + np.pi, np.pi - x, y + np.pi], axis=-1)
    turn = 2 * np.pi
    for n in range(1, len(angles)):
        near = [
            way[n] + turn * np.round((angles[n - 1] - way[n]) / turn) for way in (angles, other)
        ]
        far = [np.abs(way - angles[n - 1]).sum(axis=-1, keepdims=True) for way in near]
        angles[n] = np.where(far[0] <= far[1], *near)
    return angles
