"""BVH: against forward kinematics written frame by frame, and what is said of bad files."""

import math
import tracemalloc

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.motion import bvh
from storage.formats.motion.bvh import read_bvh, write_bvh

WHOLE = """HIERARCHY
ROOT hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT left leg
  {
    OFFSET 1.5 -2 0.5
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -4 1
    }
  }
  JOINT arm
  {
    OFFSET 0 3 0
    CHANNELS 4 Yrotation Yposition Xrotation Zposition
    JOINT hand
    {
      OFFSET 2 0 0
      CHANNELS 0
      End Site
      {
        OFFSET 1 0 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0083333
1 90 3 10 20 30 40 50 60 70 0.5 -20 0.25
2 91 3 11 20 -30 40 150 60 70 0.5 -20 0.25
3 92 3 -170 89 30 40 50 -60 70 -0.5 -20 0.75
"""
BONES = ("hip", "left leg", "left leg End", "arm", "hand", "hand End")


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def read(tmp_path):
    """A function that reads a text as a BVH file."""

    def read_text(text):
        (tmp_path / "x.bvh").write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_bvh(tmp_path / "x.bvh")

    return read_text


def naive_positions(text, frames):
    """One bone after the other, a 4x4 matrix a channel; {name: [position a frame]}."""
    header, _, motion = text.partition("MOTION")
    rows = [[float(word) for word in line.split()] for line in motion.strip().splitlines()[2:]]
    found = {}
    for row in rows[:frames]:
        values = iter(row)
        stack, pending, name = [], None, ""
        for line in header.splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] in ("ROOT", "JOINT"):
                name = " ".join(words[1:])
            elif words[0] == "End":
                name = f"{stack[-1][0]} End"
            elif words[0] == "OFFSET":
                above = stack[-1][1] if stack else np.eye(4)
                pending = above @ shift(*map(float, words[1:]))
                stack.append((name, pending))
            elif words[0] == "CHANNELS":
                stack[-1] = (name, pending @ moved(words[2:], values))
            elif words[0] == "}":
                done, matrix = stack.pop()
                found.setdefault(done, []).append(matrix[:3, 3])
    return {bone: np.array(where) for bone, where in found.items()}


def moved(channels, values):
    moves, turns = np.eye(4), np.eye(4)
    for channel in channels:
        value, axis = next(values), "XYZ".index(channel[0])
        if channel.endswith("position"):
            moves = moves @ shift(*(value * np.eye(3)[axis]))
        else:
            turns = turns @ turn(axis, math.radians(value))
    return moves @ turns


def shift(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turn(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    matrix = {
        0: [[1, 0, 0], [0, c, -s], [0, s, c]],
        1: [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        2: [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }[axis]
    whole = np.eye(4)
    whole[:3, :3] = matrix
    return whole


def test_bones_stand_where_the_naive_kinematics_puts_them(read):
    motion = read(WHOLE)
    assert motion.names == BONES
    expected = naive_positions(WHOLE, 3)
    for bone, name in enumerate(BONES):
        np.testing.assert_allclose(motion.position[:, bone], expected[name], atol=1e-9)
    assert motion.position.shape == (3, 6, 3)
    assert (motion.source, motion.rate_hz, motion.unit_m, motion.up, motion.notes) == (
        "bvh", 120.0, None, "y", (),
    )  # fmt: skip


@pytest.mark.data
@pytest.mark.parametrize("name", ["indian/indian_06", "salsa/salsa_16", "martial/martial_04"])
def test_recorded_bones_stand_where_the_naive_kinematics_puts_them(shared_data, name):
    path = shared_data / "mocap" / f"{name}.bvh"
    motion = read_bvh(path)
    expected = naive_positions(path.read_text(), 15)
    assert set(motion.names) == set(expected)
    for bone, joint in enumerate(motion.names):
        np.testing.assert_allclose(motion.position[:15, bone], expected[joint], atol=1e-8)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n{", " {").replace("\n  {", "{").replace("  ", "\t"),
        lambda text: text.replace("rotation", "ROTATION").replace("ROOT", "Root"),
        lambda text: text.replace("End Site", "End site toes"),
        lambda text: text.replace("60 70", "60\n70"),
        lambda text: text.replace("Frames: 3", "Frames:\t3").replace("Time: ", "Time:"),
        lambda text: text.replace("  CHANNELS 0\n", ""),
        lambda text: text + "\n\n",
    ],
    ids=["dos", "mac", "mark", "braces", "capitals", "named end", "wrapped", "tabs",
         "no channels", "blank lines"],
)  # fmt: skip
def test_the_same_motion_comes_out_of_every_layout(read, change):
    assert change(WHOLE) != WHOLE
    plain, changed = read(WHOLE), read(change(WHOLE))
    np.testing.assert_array_equal(changed.position, plain.position)
    assert changed.names == plain.names
    assert changed.notes == ()


def test_position_channels_that_stay_at_the_offset_hold_the_whole_position(read):
    text = WHOLE.replace("OFFSET 0 0 0", "OFFSET 0 90 0").replace("0.5 -20", "3.1 -20")
    text = text.replace("70 -0.5 -20", "70 2.9 -20").replace("0.75\n", "0.25\n")
    motion = read(text)
    without = text.replace("OFFSET 0 90 0", "OFFSET 0 0 0").replace("0 3 0\n", "0 0 0\n")
    expected = naive_positions(without, 3)
    for bone, name in enumerate(BONES):
        np.testing.assert_allclose(motion.position[:, bone], expected[name], atol=1e-9)
    assert motion.notes == (
        "The position channels of 'hip', 'arm' stay at its offset: read as the whole position, "
        "not added to it.",
    )


@pytest.mark.parametrize(
    ("frame_time", "rate_hz"),
    [("0.0083333", 120.0), ("0.00833333", 120.0), (".033333", 30.0), ("0.0333667", 29.97),
     ("0.0416667", 24.0), ("0.0166834", 59.94), ("0.04", 25.0), ("1", 1.0)],
)  # fmt: skip
def test_the_rate_is_whole_where_the_frame_time_is_that_of_a_whole_number(
    read, frame_time, rate_hz
):
    assert read(WHOLE.replace("0.0083333", frame_time)).rate_hz == pytest.approx(
        rate_hz, rel=1e-9 if rate_hz == int(rate_hz) else 1e-4
    )


def test_channels_that_are_no_numbers_leave_what_hangs_on_them_missing(read):
    motion = read(WHOLE.replace("1 90 3 10 20 30 40 50", "1 90 3 10 20 30 nan inf"))
    missing = np.isnan(motion.position).all(axis=-1)
    assert np.argwhere(missing).tolist() == [[0, BONES.index("left leg End")]]
    assert motion.notes == ("2 channels hold no number: what hangs on them is missing.",)


def test_bones_of_the_same_name_are_kept_once(read):
    motion = read(WHOLE.replace("JOINT hand", "JOINT arm"))
    assert motion.names == ("hip", "left leg", "left leg End", "arm", "arm End")
    assert motion.notes == (
        "'arm' came more than once: the first is kept, the others are left out.",
    )


def test_names_that_are_not_utf_8_are_read_and_noted(read):
    motion = read(WHOLE.replace("hip", "Hüfte").encode("latin-1"))
    assert motion.names[0] == "Hüfte"
    assert motion.notes == ("The file is not in UTF-8; its names were read as Latin-1.",)


@pytest.mark.parametrize("told", [1, 2])
def test_frames_beyond_those_that_are_told_are_read_and_noted(read, told):
    motion = read(WHOLE.replace("Frames: 3", f"Frames: {told}"))
    np.testing.assert_array_equal(motion.position, read(WHOLE).position)
    assert motion.notes == (f"'Frames:' says {told}; all of the 3 frames were read.",)


@pytest.mark.data
def test_one_frame_more_than_rokoko_tells_is_read(shared_data):
    motion = read_bvh(shared_data / "reports" / "R02" / "rokoko_plus1.bvh")
    assert len(motion.position) == 60
    assert motion.notes == ("'Frames:' says 59; all of the 60 frames were read.",)


def scaled(scale):
    """The whole file with scale channels on the root and on the hand."""
    text = WHOLE.replace("CHANNELS 6 X", "CHANNELS 9 Xscale Yscale Zscale X")
    text = text.replace("CHANNELS 0", "CHANNELS 2 yScale Zrotation")
    rows = text.index("0.0083333\n") + 10
    lines = [f"1 1.0 0.9999999 {line} {scale} 30" for line in text[rows:].splitlines()]
    return text[:rows] + "\n".join(lines) + "\n"


def test_scale_channels_of_one_are_left_out(read):
    motion, plain = read(scaled("1.000")), read(WHOLE.replace("CHANNELS 0", "CHANNELS 0"))
    turned = [BONES.index(name) for name in BONES if name != "hand End"]
    np.testing.assert_array_equal(motion.position[:, turned], plain.position[:, turned])
    assert motion.names == BONES
    assert motion.notes == ("The scale channels are 1 all along: left out.",)


@pytest.mark.parametrize("scale", ["1.2", "0", "100"])
def test_bones_that_change_their_size_are_refused(read, scale):
    with pytest.raises(InputError, match=rf"scales 'hand' \('hand' by {scale}\), where bones that"):
        read(scaled(scale))


def test_many_frames_are_placed_as_few_are(read, monkeypatch):
    motion = read(WHOLE)
    monkeypatch.setattr(bvh, "_FRAMES_AT_ONCE", 2)
    np.testing.assert_array_equal(read(WHOLE).position, motion.position)


def test_reading_takes_little_more_than_the_numbers_and_the_file(read):
    head, rows = WHOLE[: WHOLE.index("1 90")].replace("Frames: 3", "Frames: 60000"), 20_000
    text = (head + WHOLE[WHOLE.index("1 90") :] * rows).encode()
    read(WHOLE)
    tracemalloc.start()
    try:
        motion = read(text)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    numbers = 60_000 * 13 * 8
    assert motion.position.shape == (60_000, 6, 3)
    assert peak < 3 * numbers
    np.testing.assert_array_equal(motion.position[-3:], motion.position[:3])


DAMAGED = "has a damaged hierarchy: "


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (WHOLE, "", "is empty; bring a BVH file"),
        (WHOLE, "\0BVH", "holds binary data, not text; bring a BVH file"),
        ("HIERARCHY", "HIERARCHIES", "does not begin with HIERARCHY; bring a BVH file"),
        ("MOTION", "", "has no line MOTION: it is cut short or holds no motion"),
        ("Frames: 3", "", "has no lines 'Frames:' and 'Frame Time:' after MOTION"),
        ("Frames: 3", "Frames: 0", "has '0' frames, where 1 or more are wanted"),
        ("Frames: 3", "Frames: -3", "has '-3' frames, where 1 or more are wanted"),
        ("Frames: 3", "Frames: 4", "holds 3 frames of 13 numbers where it tells 4: it is cut"),
        (" 0.75\n", " 0.75\n1 2\n", "holds 3.15385 frames of 13 numbers where it tells 3"),
        ("2 91 3", "2 9_1 3", "has '9_1' in frame 2 where a number is wanted"),
        ("Frames: 3", "Frames: 999999999999", "holds 3 frames of 13 numbers where it tells"),
        (" 0.75\n", "\n", "holds 2.92308 frames of 13 numbers where it tells 3"),
        (" 0.25\n2 ", "\n0.25 2 ", "has 12 numbers in frame 1 where 13 are wanted"),
        ("0.0083333", "0", "has the frame time '0' where seconds above 0 are wanted; write"),
        ("0.0083333", "nan", "has the frame time 'nan' where seconds above 0 are wanted"),
        ("0.0083333", "-1", "has the frame time '-1' where seconds above 0 are wanted"),
        ("0.0083333", "", "has the frame time"),
        ("0.0083333", "inf", "a rate of 0 frames a second .1 / Frame Time."),
        ("0.0083333", "1e-9", r"a rate of 1e\+09 frames a second"),
        ("2 91 3", "2 91;5 3", "has '91;5' in frame 2 where a number is wanted"),
        ("2 91 3", "2 9.1.5 3", "has a malformed number; export it again"),
        ("OFFSET 0 3 0", "OFFSET 0 3", DAMAGED + "the OFFSET of 'arm' is not three numbers"),
        ("OFFSET 0 3 0", "OFFSET 0 inf 0", DAMAGED + "the OFFSET of 'arm' is not three"),
        ("OFFSET 0 3 0", "", DAMAGED + "'arm' have no OFFSET"),
        ("OFFSET 0 3 0", "OFFSET 0 3 0 9", DAMAGED + "'9' stands where it cannot"),
        ("CHANNELS 4", "CHANNELS 3", DAMAGED + "'Zposition' stands where it cannot"),
        ("CHANNELS 4", "CHANNELS 5", DAMAGED + "the CHANNELS of 'arm' are not a number up to"),
        ("CHANNELS 4 Y", "CHANNELS 4 W", DAMAGED + "the CHANNELS of 'arm' are not a number"),
        ("JOINT arm", "JOINT", DAMAGED + "a bone has no name"),
        ("JOINT arm", "ROOT arm", DAMAGED + "ROOT stands where it cannot"),
        ("ROOT hip", "JOINT hip", DAMAGED + "JOINT stands where it cannot"),
        ("}\nMOTION", "MOTION", DAMAGED + "'hip' is not closed"),
        (WHOLE[9 : WHOLE.index("MOTION")], "\n", "holds no bones that move; export it with"),
    ],
)
def test_a_bad_file_is_refused_with_a_sentence(read, old, new, message):
    assert old in WHOLE
    with pytest.raises(InputError, match=message) as caught:
        read(WHOLE.replace(old, new))
    assert "x.bvh" in str(caught.value)


def test_a_bvh_of_absurdly_many_bones_is_refused(read):
    many = "JOINT b\n{\nOFFSET 0 1 0\n}\n"
    with pytest.raises(InputError, match="holds 5006 bones, where 5000 at most are wanted"):
        read(WHOLE.replace("  JOINT arm", many * 5000 + "  JOINT arm"))
    deep = "JOINT b\n{\nOFFSET 0 1 0\n" * 4000 + "}" * 4000
    assert read(WHOLE.replace("  JOINT arm", deep + "  JOINT arm")).names == (
        *BONES[:3], "b", *BONES[3:],
    )  # fmt: skip
    rows = "Frames: 9000\nFrame Time: 0.01\n" + "0\n" * 9000
    few = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n" + deep + "}\nMOTION\n"
    with pytest.raises(InputError, match="has 4,001 names for 9,000 frames but too few"):
        read(few + rows)


def write_arm(path, **changes):
    """A root with an arm of two bones, 4 frames."""
    arguments = {
        "names": ["root", "upper", "lower"],
        "parents": [-1, 0, 1],
        "offset": np.array([[0.0, 0, 0], [0, 0.3, 0], [0.2, 0, 0]]),
        "root_position": np.arange(12.0).reshape(4, 3) / 10,
        "rotation": np.tile(np.eye(3), (4, 3, 1, 1)),
        "rate_hz": 30.0,
    } | changes
    write_bvh(path, **arguments)
    return arguments


def test_rotations_are_written_without_jumps(tmp_path):
    angles = np.linspace(0, 4 * np.pi, 50)
    zero, one = np.zeros(50), np.ones(50)
    tilted = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # a quarter turn about x: gimbal lock
    about_y = np.array(
        [[np.cos(angles), zero, np.sin(angles)], [zero, one, zero],
         [-np.sin(angles), zero, np.cos(angles)]]
    ).transpose(2, 0, 1)  # fmt: skip
    rotation = np.stack([about_y, about_y @ tilted, np.tile(np.eye(3), (50, 1, 1))], axis=1)
    given = write_arm(
        tmp_path / "x.bvh", rotation=rotation, root_position=np.zeros((50, 3)), rate_hz=120.0
    )
    lines = (tmp_path / "x.bvh").read_text().splitlines()
    rows = np.array([[float(word) for word in line.split()] for line in lines[-50:]])
    assert np.abs(np.diff(rows[:, 3:6], axis=0)).max() < 16
    assert rows[-1, 5] == pytest.approx(720)
    motion = read_bvh(tmp_path / "x.bvh")
    assert motion.rate_hz == 120.0
    upper = rotation[:, 0] @ given["offset"][1]
    lower = upper + rotation[:, 0] @ rotation[:, 1] @ given["offset"][2]
    read = motion.position[:, motion.names.index("lower")] / 100
    np.testing.assert_allclose(read, lower, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": ["root", "a b", "c"]}, "the name 'a b' cannot stand in such a file"),
        ({"parents": [-1, 2, 0]}, "each parent has to stand before its children, the root"),
        ({"parents": [-1, 0]}, "offset, root_position, rotation and parents of .* not agree"),
        ({"root_position": np.full((4, 3), np.nan)}, "cannot hold a gap: fill it first"),
        ({"rate_hz": -1.0}, "rate_hz is -1.0, a positive number is wanted"),
    ],
)
def test_wrong_arguments_of_the_writer_are_named(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        write_arm(tmp_path / "x.bvh", **changes)
    assert not list(tmp_path.iterdir())
