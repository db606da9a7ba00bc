"""TRC: what the header, the names and the rows may look like, and what is said of bad files."""

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.motion.trc import read_trc, write_trc

HEAD = "PathFileType\t4\t(X/Y/Z)\tx.trc\n"
KEYS = "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
VALUES = "50\t50\t3\t2\tcm\n"
NAMES = "Frame#\tTime\tA\t\t\tB\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
ROWS = "1\t0\t1\t2\t3\t4\t5\t6\n2\t0.02\t\t\t\t7\t8\t9\n3\t0.04\t10\t11\t12\t\t\t\n"
WHOLE = HEAD + KEYS + VALUES + NAMES + ROWS
POSITION = np.array(
    [[[1, 2, 3], [4, 5, 6]], [[np.nan] * 3, [7, 8, 9]], [[10, 11, 12], [np.nan] * 3]]
)


@pytest.fixture
def read(tmp_path):
    """A function that reads a text (or bytes) as a TRC file."""

    def read_text(text):
        data = text if isinstance(text, bytes) else text.encode()
        (tmp_path / "x.trc").write_bytes(data)
        return read_motion_file(tmp_path / "x.trc")

    return read_text


@pytest.mark.data
def test_the_ballet_is_read_as_its_cells_say(shared_data):
    path = shared_data / "trc" / "ballet_reduced.trc"
    motion = read_trc(path)
    lines = path.read_text().splitlines()
    row = lines[-1].split("\t")
    names = lines[3].split("\t")
    expected = [float(cell) for cell in row[names.index("LTHI") : names.index("LTHI") + 3]]
    np.testing.assert_array_equal(motion.position[-1, motion.names.index("LTHI")], expected)
    assert motion.position.shape == (100, 41, 3)
    assert (motion.rate_hz, motion.unit_m, motion.up, motion.notes) == (30.0, 0.001, None, ())


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace("Z2\n", "Z2\n\n"),
        lambda text: text.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", "\n"),
        lambda text: text.replace("12\t\t\t\n", "12\n"),
        lambda text: text.replace("\t", ","),
        lambda text: text.replace("A\t\t\tB\t\t\n", "A\tB\n"),
        lambda text: text.replace("6\n", "6\t\n").replace("9\n", "9\t\n"),
        lambda text: text.replace("\t4\t5", "\t 4\t5.0e0"),
    ],
    ids=["plain", "dos", "mac", "mark", "six lines", "no axes", "trimmed", "commas",
         "names side by side", "tab at the end", "spaces"],
)  # fmt: skip
def test_the_same_motion_comes_out_of_every_layout(read, change):
    motion = read(change(WHOLE))
    np.testing.assert_array_equal(motion.position, POSITION)
    assert motion.names == ("A", "B")
    assert (motion.rate_hz, motion.unit_m, motion.up, motion.notes) == (50.0, 0.01, None, ())


def test_cells_between_spaces_are_read_where_none_is_missing(read):
    text = WHOLE.replace("\t\t\t\t7", "\t0\t0\t0\t7").replace("12\t\t\t", "12\t0\t0\t0")
    motion = read(text.replace("\t", "  "))
    np.testing.assert_array_equal(motion.position, POSITION)
    assert motion.notes == (
        "2 positions are exactly 0, 0, 0 and were taken as missing (frames of A 1, B 1).",
    )


@pytest.mark.data
def test_gaps_written_as_zeros_are_gaps(shared_data):
    folder = shared_data / "reports" / "R01"
    zeros, blanks = (read_trc(folder / f"{name}.trc") for name in ("zero", "expected_as_blank"))
    np.testing.assert_array_equal(zeros.position, blanks.position)
    assert np.isnan(zeros.position).any()
    assert zeros.notes == (
        "53 positions are exactly 0, 0, 0 and were taken as missing (frames of RWrist 30, "
        "RHip 23).",
    )


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ("\t3\t2\tcm", "\t3\t7\tcm", "NumMarkers says 7; there are 2 names, which were read."),
        ("\t3\t2\tcm", "\t2\t2\tcm", "NumFrames says 2; all of the 3 frames were read."),
        ("\tcm", "\t", "The file does not say its unit."),
        ("\tcm", "\tcubits", "The file's unit 'cubits' is not known."),
        ("50\t50", "25\t25", "The column Time runs at 50 frames a second; DataRate 25 is used."),
        ("3\t0.04", "3\t0", "The column Time does not run evenly; DataRate 50 is used."),
        ("\t1\t2\t3\t4", "\tinf\t2\t3\t4", "1 positions are infinite or absurdly far away"),
        ("\t1\t2\t3\t4", "\t1\t-1e30\t3\t4", "1 positions are infinite or absurdly far away"),
        ("Units\n", "Units\textra\n", None),
        ("B\t\t\n", "B\t\t\tC\t\t\n", "There are no columns for 'C': left out."),
        ("4\t5\t6\n", "4\t5\t6\t7\t8\t9\n", "There are columns without a name: left out."),
        ("A\t\t\tB", "B\t\t\tB", "'B' came more than once: the first is kept"),
    ],
)
def test_what_had_to_be_assumed_is_noted(read, old, new, note):
    assert old in WHOLE
    motion = read(WHOLE.replace(old, new))
    if note is None:
        assert motion.notes == ()
    else:
        assert any(note in said for said in motion.notes)
    assert motion.position.shape[1:] == (len(motion.names), 3)
    known = np.isfinite(motion.position[:, -1])
    np.testing.assert_array_equal(
        motion.position[:, -1][known], POSITION[:, len(motion.names) - 1][known]
    )


def test_a_marker_without_a_name_is_left_out_and_does_not_shift_the_others(read):
    motion = read(WHOLE.replace("\tA\t\t\tB", "\t\t\t\tB"))
    assert motion.names == ("B",)
    np.testing.assert_array_equal(motion.position[:, 0], POSITION[:, 1])


def test_names_that_are_not_utf_8_are_read_and_noted(read):
    motion = read(WHOLE.replace("A", "Hüfte").encode("latin-1"))
    assert motion.names == ("Hüfte", "B")
    assert motion.notes == ("The file is not in UTF-8; its names were read as Latin-1.",)


def test_a_file_without_a_last_line_end_is_read_with_a_note(read):
    motion = read(WHOLE.replace("12\t\t\t\n", "12\t13\t14\t15"))
    assert motion.position[2, 1].tolist() == [13, 14, 15]
    assert motion.notes == ("The file does not end with a line end; its last number may be cut.",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; bring a TRC file"),
        ("\n \t\r\n", "is empty; bring a TRC file"),
        ("a\0b", "holds binary data, not text; bring a TRC file"),
        ("HIERARCHY\nROOT a\n", "none of its lines begins with Frame# and Time"),
        (HEAD + NAMES + ROWS, "has no line with DataRate and a line of values below it"),
        (WHOLE.replace("50\t50", "0\t50"), "a rate of 0 frames a second .DataRate."),
        (WHOLE.replace("50\t50", "nan\t50"), "a rate of nan frames a second"),
        (WHOLE.replace("50\t50", "-50\t50"), "a rate of -50 frames a second"),
        (WHOLE.replace("50\t50", "x\t50"), "a rate of nan frames a second"),
        (WHOLE.replace("50\t50", "1e9\t50"), r"a rate of 1e\+09 frames a second"),
        (WHOLE.replace("A\t\t\tB\t\t", "\t\t\t\t\t"), "holds no markers; export it with its"),
        (HEAD + KEYS + VALUES + NAMES, "holds no frames; export it with its frames"),
        (WHOLE.replace("\t3\t2\t", "\t5\t2\t"), "cut short: it holds 3 whole frames of 5"),
        (WHOLE[:-20], "cut short: it holds 2 whole frames of 3"),
        (WHOLE.replace("\t8\t", "\t8,5\t"),
         "has '8,5' in frame 2 .about line 7. where a number or nothing is wanted"),
        (WHOLE.replace("\t8\t", "\t1_0\t"), "has '1_0' in frame 2"),
        (WHOLE.replace("7\t8", "78"), "has 5 cells in frame 2 .about line 7., not three"),
        (WHOLE.replace("X1\tY1\tZ1", "Z1\tX1\tY1"), "where X1 Y1 Z1 or the first frame is"),
        (WHOLE.replace("2\t0.02", "4\t0.9"), "evenly neither in Frame# nor in Time"),
        (WHOLE.replace("\t", " "), "has 5 numbers where others have 8|spaces cannot tell"),
        (HEAD + KEYS + VALUES + "Frame#\tTime\tA\n\n1\t0\n2\t0\n3\t0\n", "has no columns below"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_with_a_sentence(read, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read(text)
    assert "x.trc" in str(caught.value)


def test_a_few_bytes_cannot_ask_for_much_memory(read):
    names = "".join(f"m{n}\t\t\t" for n in range(5000))
    wide = "1\t0" + "\t1" * 15_000 + "\n"
    rows = "".join(f"{n}\t{n}\n" for n in range(2, 9000))
    text = HEAD + KEYS + "1\t1\t3\t2\tcm\nFrame#\tTime\t" + names + "\n\n" + wide + rows
    with pytest.raises(InputError, match="too few numbers for them"):
        read(text)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"cannot be read .No such file or directory."):
        read_trc(tmp_path / "absent.trc")
    with pytest.raises(InputError, match=r"cannot be read .Is a directory.; bring a TRC file"):
        read_trc(tmp_path)


@pytest.mark.parametrize("name", ["dance.fbx", "dance", "dance.c3d.zip"])
def test_a_file_of_another_kind_is_told_what_is_accepted(tmp_path, name):
    with pytest.raises(InputError, match=rf"{name} .* ends in \.c3d, \.trc or \.bvh"):
        read_motion_file(tmp_path / name)


def test_the_suffix_may_be_in_capitals(tmp_path):
    (tmp_path / "x.TRC").write_text(WHOLE)
    assert read_motion_file(tmp_path / "x.TRC").source == "trc"


@pytest.mark.parametrize(
    ("shape", "names", "rate", "message"),
    [
        ((2, 3), ["A"], 30.0, r"position is \(2, 3\), \(time, 1, 3\) is wanted"),
        ((0, 1, 3), ["A"], 30.0, "there is no frame or no joint to write"),
        ((2, 1, 3), ["A\tB"], 30.0, r"the name 'A\\tB' cannot stand in such a file"),
        ((2, 1, 3), ["A"], 0.0, "rate_hz is 0.0, a positive number is wanted"),
        ((2, 2, 3), ["A", "A"], np.nan, "more than once; rate_hz is nan"),
    ],
)
def test_wrong_arguments_of_the_writer_are_named(tmp_path, shape, names, rate, message):
    with pytest.raises(ValueError, match=message):
        write_trc(tmp_path / "x.trc", np.zeros(shape), names, rate)
    assert not list(tmp_path.iterdir())


def test_an_infinite_position_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="a position is infinite; write NaN"):
        write_trc(tmp_path / "x.trc", np.full((2, 1, 3), np.inf), ["A"], 30.0)


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "x.trc").write_text("old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_trc(tmp_path / "x.trc", np.zeros((2, 1, 3)), ["A"], 30.0)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]
