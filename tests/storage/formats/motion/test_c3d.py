"""C3D: against two other readers, in six encodings, and what is noted of odd files."""

import contextlib
import io
import lzma
import struct
import warnings

import c3d
import ezc3d
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.motion.c3d import read_c3d, write_c3d
from tests.storage.formats.motion.conftest import change

INTEL, DEC, MIPS = 84, 85, 86
READABLE = ("Eb015pi", "Eb015pr", "PiG_Motion-FlatFoot-Full", "pc_real", "walkingOptiTrack")


def read_with_ezc3d(path):
    file = ezc3d.c3d(str(path))
    labels = [label.strip() for label in file["parameters"]["POINT"]["LABELS"]["value"]]
    return file["data"]["points"][:3].transpose(2, 1, 0), labels


def read_with_py_c3d(path):
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with contextlib.redirect_stdout(io.StringIO()):
            reader = c3d.Reader(file)
            points = np.array([frame[1] for frame in reader.read_frames()], float)
    points[points[..., 3] < 0] = np.nan
    return points[..., :3]


@pytest.mark.data
@pytest.mark.parametrize("name", READABLE)
def test_positions_are_those_that_ezc3d_reads(shared_data, name):
    path = shared_data / "c3d" / f"{name}.c3d"
    theirs, labels = read_with_ezc3d(path)
    ours = read_c3d(path)
    columns = [labels.index(marker) for marker in ours.names]
    np.testing.assert_allclose(ours.position, theirs[:, columns], rtol=0, atol=1e-3)
    assert np.isnan(ours.position).any()
    assert not np.isnan(ours.position).all()


@pytest.mark.data
@pytest.mark.parametrize("name", ["Eb015pr", "pc_real"])
def test_positions_are_those_that_py_c3d_reads(shared_data, name):
    path = shared_data / "c3d" / f"{name}.c3d"
    np.testing.assert_allclose(read_c3d(path).position, read_with_py_c3d(path), rtol=0, atol=1e-3)


@pytest.mark.data
def test_the_real_and_the_integer_form_of_a_trial_agree_to_the_scale(shared_data):
    real, integer = (read_c3d(shared_data / "c3d" / f"Eb015p{form}.c3d") for form in "ri")
    assert (real.names, real.rate_hz, real.unit_m) == (integer.names, 50.0, 0.001)
    np.testing.assert_array_equal(np.isnan(real.position), np.isnan(integer.position))
    scale = 0.08333334  # POINT:SCALE of the integer file, mm
    assert np.nanmax(np.abs(real.position - integer.position)) <= max(0.05, scale / 2)


@pytest.mark.data
@pytest.mark.parametrize("processor", [DEC, MIPS])
@pytest.mark.parametrize("name", ["Eb015pr", "Eb015pi"])
def test_a_trial_is_the_same_in_every_byte_order(shared_data, tmp_path, name, processor):
    original = shared_data / "c3d" / f"{name}.c3d"
    (tmp_path / "other.c3d").write_bytes(in_byte_order(original.read_bytes(), processor))
    ours, other = read_c3d(original), read_c3d(tmp_path / "other.c3d")
    np.testing.assert_array_equal(other.position, ours.position)
    assert (other.names, other.rate_hz, other.unit_m) == (ours.names, ours.rate_hz, 0.001)
    assert other.notes == ours.notes == ()


def in_byte_order(data, processor):
    """An Intel file rewritten as a DEC or MIPS one."""
    out = bytearray(data)
    ints = [*range(2, 12, 2), 16, 18]
    parameters, at = 512, 516
    out[parameters + 3] = processor
    floats = [12, 20]
    while data[at]:
        length, group = struct.unpack_from("bb", data, at)
        pointer = at + 2 + abs(length)
        step = struct.unpack_from("<H", data, pointer)[0]
        ints.append(pointer)
        if group > 0:
            kind, dimensions = struct.unpack_from("bB", data, pointer + 2)
            shape = data[pointer + 4 : pointer + 4 + dimensions]
            first = pointer + 4 + dimensions
            count = int(np.prod(list(shape))) if dimensions else 1
            ints += range(first, first + 2 * count, 2) if kind == 2 else ()
            floats += range(first, first + 4 * count, 4) if kind == 4 else ()
        if step == 0:
            break
        at = pointer + step
    start = (struct.unpack_from("<H", data, 16)[0] - 1) * 512
    if struct.unpack_from("<f", data, 12)[0] < 0:
        floats += range(start, len(data) - 3, 4)
    else:
        ints += range(start, len(data) - 1, 2)
    for place in ints if processor == MIPS else ():
        out[place : place + 2] = data[place : place + 2][::-1]
    for place in floats:
        four = data[place : place + 4]
        if processor == DEC and any(four):
            times_four = struct.pack("<f", struct.unpack("<f", four)[0] * 4)
            out[place : place + 4] = times_four[2:] + times_four[:2]
        elif processor == MIPS:
            out[place : place + 4] = four[::-1]
    return bytes(out)


@pytest.mark.data
def test_a_parameter_section_without_some_descriptions_is_read_by_its_pointers(shared_data):
    path = shared_data / "c3d" / "badParameterOffset.c3d"
    motion = read_c3d(path)
    raw = np.frombuffer(path.read_bytes(), "<f4", 111 * 41 * 4, 9 * 512).reshape(111, 41, 4)
    expected = np.where(raw[..., 3:] < 0, np.nan, raw[..., :3])
    np.testing.assert_array_equal(motion.position, expected)
    assert motion.names[::40] == ("Point    1", "Point   41")
    assert (motion.rate_hz, motion.unit_m) == (250.0, 0.001)


@pytest.mark.data
def test_modelled_angles_and_moments_are_not_markers(shared_data):
    motion = read_c3d(shared_data / "c3d" / "PiG_Motion-FlatFoot-Full.c3d")
    assert {"LASI", "LHEE"} <= set(motion.names)
    assert not {"LHipAngles", "LKneePower", "RAnkleMoment"} & set(motion.names)
    assert motion.notes == ("80 modelled angles, forces or the like: left out.",)


def test_what_we_write_other_libraries_read(written):
    path, position = written
    theirs, labels = read_with_ezc3d(path)
    np.testing.assert_allclose(theirs / 1000, position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(read_with_py_c3d(path) / 1000, position, rtol=0, atol=1e-6)
    assert labels == ["RHip", "LHip", "Neck", "Head"]


def test_more_frames_than_the_header_can_count_are_written_and_read(tmp_path, rng):
    position = rng.normal(0, 1, (70_001, 2, 3))
    write_c3d(tmp_path / "long.c3d", position, ["A", "B"], 120.0)
    motion = read_c3d(tmp_path / "long.c3d")
    np.testing.assert_allclose(motion.position / 1000, position, rtol=0, atol=1e-6)
    assert read_with_ezc3d(tmp_path / "long.c3d")[0].shape == (70_001, 2, 3)


def test_more_names_than_one_parameter_holds_go_on_in_the_next(tmp_path, rng):
    names = [f"marker{n}" for n in range(300)]
    position = rng.normal(0, 1, (2, 300, 3))
    write_c3d(tmp_path / "many.c3d", position, names, 120.0)
    assert read_c3d(tmp_path / "many.c3d").names == tuple(names)


def write_with_ezc3d(path, labels, *, unit="mm", frames=3, rate=50.0):
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["data"]["points"] = np.arange(4.0 * len(labels) * frames).reshape(4, -1, frames)
    file.write(str(path))
    return file["data"]["points"][:3].transpose(2, 1, 0)


@pytest.mark.parametrize(
    ("labels", "names", "note"),
    [
        (["TK:LASI", "TK:RASI"], ("LASI", "RASI"), None),
        (["TK:LASI", "TK:RASI", "*12"], ("LASI", "RASI"), "1 of 3 points have no name"),
        (["A:LASI", "B:LASI"], ("A:LASI", "B:LASI"), "more than one subject"),
        (["LASI", "RASI", "LASI"], ("LASI", "RASI"), "'LASI' came more than once"),
    ],
    ids=["one subject", "unlabeled", "two subjects", "twice"],
)
def test_labels_become_names(tmp_path, labels, names, note):
    points = write_with_ezc3d(tmp_path / "x.c3d", labels)
    motion = read_c3d(tmp_path / "x.c3d")
    assert motion.names == names
    np.testing.assert_allclose(motion.position, points[:, : len(names)])
    assert [note in said for said in motion.notes] == ([] if note is None else [True])


@pytest.mark.parametrize(("unit", "meters"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)])
def test_the_unit_is_that_of_the_file(tmp_path, unit, meters):
    write_with_ezc3d(tmp_path / "x.c3d", ["A"], unit=unit)
    assert read_c3d(tmp_path / "x.c3d").unit_m == meters


def test_an_unknown_unit_is_noted(tmp_path):
    write_with_ezc3d(tmp_path / "x.c3d", ["A"], unit="ell")
    motion = read_c3d(tmp_path / "x.c3d")
    assert motion.unit_m is None
    assert motion.notes == ("The file's unit 'ell' is not known.",)


def test_names_that_are_not_utf_8_are_read_and_noted(written):
    path, _ = written
    path.write_bytes(path.read_bytes().replace(b"RHip", b"H\xfcft"))
    motion = read_c3d(path)
    assert motion.names[0] == "Hüft"
    assert motion.notes == ("The names are not in UTF-8; they were read as Latin-1.",)


def test_japanese_labels_in_cp932_are_read_and_noted(written):
    path, _ = written
    path.write_bytes(path.read_bytes().replace(b"RHipLHip", "右腰".encode("cp932") + b"LHip"))
    motion = read_c3d(path)
    assert motion.names[:2] == ("右腰", "LHip")
    assert motion.notes == (
        "The names are not in UTF-8; they were read as cp932 (Japanese Windows).",
    )
    path.write_bytes(path.read_bytes().replace("右腰".encode("cp932"), "Таз ".encode("cp1251")))
    with pytest.raises(InputError, match="encoding that cannot be told"):
        read_c3d(path)


@pytest.mark.parametrize(
    ("said", "up"), [(b"+Z", "z"), (b"+Y", "y"), (b"-Z", "-z"), (b"Z ", "z"), (b"up", None)]
)
def test_the_screen_says_which_axis_points_up(written, said, up):
    path, _ = written
    data = path.read_bytes()
    at = data.index(b"Y_SCREEN") + len(b"Y_SCREEN") + 6
    assert data[at : at + 2] == b"+Y"
    path.write_bytes(data[:at] + said + data[at + 2 :])
    assert read_c3d(path).up == up


def test_positions_at_zero_with_a_residual_of_zero_are_gaps(written):
    path, position = written
    data = path.read_bytes()
    start = (struct.unpack_from("<H", data, 16)[0] - 1) * 512
    path.write_bytes(data[:start] + bytes(16) + data[start + 16 :])
    motion = read_c3d(path)
    assert np.isnan(motion.position[0, 0]).all()
    np.testing.assert_allclose(motion.position[0, 1:] / 1000, position[0, 1:], rtol=0, atol=1e-6)
    assert "1 positions are exactly 0, 0, 0" in motion.notes[0]


def only_sixteen_bits(data, count):
    """The file with no other count of its frames than a 16-bit one."""
    spoiled = bytearray(data.replace(b"ACTUAL", b"XCTUAL"))
    struct.pack_into("<H", spoiled, 8, count)
    return change(bytes(spoiled), "FRAMES", struct.pack("<H", count))


@pytest.mark.parametrize("filling", [0, 480])
@pytest.mark.parametrize("count", [65535, 66_001 - 65536], ids=["stops", "begins again"])
def test_frames_that_the_header_cannot_count_are_read_all_the_same(tmp_path, count, filling):
    position = np.random.default_rng(9).normal(0, 1, (66_001, 2, 3))
    write_c3d(tmp_path / "long.c3d", position, ["A", "B"], 120.0)
    data = (tmp_path / "long.c3d").read_bytes()
    assert len(data) % 512 == 32
    path = tmp_path / "short.c3d"
    path.write_bytes(only_sixteen_bits(data, count) + bytes(filling))
    motion = read_c3d(path)
    np.testing.assert_allclose(motion.position / 1000, position, rtol=0, atol=1e-6)
    assert motion.notes == (
        "The file counts its frames only to 65,535; it holds 66,001, which were read.",
    )


@pytest.mark.data
def test_a_long_trial_keeps_all_of_its_frames(shared_data, tmp_path):
    packed = shared_data / "reports" / "R10" / "long8.c3d.xz"
    (tmp_path / "long.c3d").write_bytes(lzma.decompress(packed.read_bytes()))
    assert read_c3d(tmp_path / "long.c3d").position.shape[0] == 66_000


def test_what_is_left_out_is_said_in_frames_and_seconds(written):
    path, position = written
    data = path.read_bytes()
    path.write_bytes(data + bytes(range(1, 65)) * 16)
    motion = read_c3d(path)
    assert motion.position.shape == position.shape
    assert "would be 19 frames more (0.317 s)" in motion.notes[0]


def test_infinite_and_absurd_positions_are_missing(written):
    path, position = written
    data = path.read_bytes()
    start = (struct.unpack_from("<H", data, 16)[0] - 1) * 512
    path.write_bytes(data[:start] + struct.pack("<2f", np.inf, 1e30) + data[start + 8 :])
    motion = read_c3d(path)
    assert np.isnan(motion.position[0, 0]).all()
    np.testing.assert_allclose(motion.position[1:] / 1000, position[1:], rtol=0, atol=1e-6)
    assert motion.notes == ("1 positions are infinite or absurdly far away: taken as missing.",)


def test_where_header_and_parameters_disagree_the_length_decides(written):
    path, position = written
    data = bytearray(path.read_bytes())
    struct.pack_into("<H", data, 2, 400)
    struct.pack_into("<H", data, 8, 1000)
    path.write_bytes(data)
    motion = read_c3d(path)
    np.testing.assert_allclose(motion.position / 1000, position, rtol=0, atol=1e-6)
    assert "length of the file fits 5 frames of 4 markers" in motion.notes[0]


def test_a_header_rate_that_differs_is_noted(written):
    path, _ = written
    data = bytearray(path.read_bytes())
    struct.pack_into("<f", data, 20, 25.0)
    path.write_bytes(data)
    motion = read_c3d(path)
    assert motion.rate_hz == 60.0
    assert motion.notes == ("POINT:RATE says 60 Hz, the header 25: the first is used.",)
