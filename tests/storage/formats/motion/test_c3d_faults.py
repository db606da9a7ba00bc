"""C3D files that cannot be right are refused with what is wrong; so are wrong arguments."""

import struct

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.motion.c3d import read_c3d, write_c3d
from tests.storage.formats.motion.conftest import change


def floats(*values):
    return struct.pack(f"<{len(values)}f", *values)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda _: b"", "is empty; bring a C3D file"),
        (lambda _: bytes(9000), "is empty; bring a C3D file"),
        (lambda _: b"HIERARCHY\n" * 300, "is not a C3D file .* bring a C3D file"),
        (lambda d: d[:700], "is not a C3D file .* ends within the header"),
        (lambda d: b"\x63" + d[1:], "parameters are in block 99, where there is none"),
        (lambda d: d[:515] + b"\x07" + d[516:], "processor 7 wrote it, where 84"),
        (lambda d: d[:518] + b"\x01" + d[519:], "damaged parameter section: the name at byte"),
        (lambda d: d.replace(b"POINT", b"POUNT"), "damaged parameter section: it has no group"),
        (lambda d: d.replace(b"USED\x07\0\x02", b"USED\x07\0\x03"), "POINT:USED is of no known"),
        (lambda d: d.replace(b"USED\x07\0\x02\0", b"USED\x07\0\x02\1"), "is longer than its"),
        (lambda d: d[:-512], "cut short: it holds 0 of the 5 frames"),
        (lambda d: d[:-200] + b"\0" * 3, "bytes more than|cut short"),
        (lambda d: d + b"\0" * 3, "195 bytes more than its 5 frames take"),
        (lambda d: change(d, "RATE", b"\0\0\xc0\x7f"), "a rate of nan frames a second"),
        (lambda d: change(d, "RATE", b"\0\0\x80\x7f"), "a rate of inf frames a second"),
        (lambda d: change(d, "RATE", b"\0\0\x80\xc3"), "a rate of -256 frames a second"),
        (lambda d: change(d[:20] + bytes(4) + d[24:], "RATE", bytes(4)), "a rate of 0 frames"),
    ],
)
def test_a_bad_file_is_refused_with_a_sentence(written, spoil, message):
    path, _ = written
    spoiled = spoil(path.read_bytes())
    assert spoiled != path.read_bytes()
    path.write_bytes(spoiled)
    with pytest.raises(InputError, match=message) as caught:
        read_motion_file(path)
    assert str(path) in str(caught.value)


def test_no_markers_no_frames_and_no_names_are_refused(written):
    path, _ = written
    data = bytearray(path.read_bytes())
    for message, places in (
        ("holds no markers; export it with", {2: 0}),
        ("holds no frames; export it with", {6: 1, 8: 0}),
    ):
        spoiled = bytearray(data)
        for place, value in places.items():
            struct.pack_into("<H", spoiled, place, value)
        whole = bytes(spoiled)
        if 2 in places:
            whole = change(whole, "USED", bytes(2))
        else:
            whole = change(whole, "FRAMES", bytes(2)).replace(b"ACTUAL", b"XCTUAL")
        path.write_bytes(whole)
        with pytest.raises(InputError, match=message):
            read_c3d(path)
    path.write_bytes(bytes(data).replace(b"RHipLHipNeckHead", b"*1  *2  *3      "))
    with pytest.raises(InputError, match="no marker that has a name; label its markers"):
        read_c3d(path)


def test_counts_that_fit_no_length_are_refused(written):
    path, _ = written
    data = bytearray(path.read_bytes())
    struct.pack_into("<H", data, 8, 3)
    path.write_bytes(data + bytes(2048))
    with pytest.raises(InputError, match="different numbers of markers or frames"):
        read_c3d(path)


@pytest.mark.data
def test_integer_files_whose_scale_is_in_doubt_are_refused(tmp_path, shared_data):
    path = tmp_path / "integer.c3d"
    data = bytearray((shared_data / "c3d" / "Eb015pi.c3d").read_bytes())
    scale = bytes(data[12:16])
    struct.pack_into("<f", data, 12, 0.5)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"by 0.0833333 in its parameters and by 0.5 in its"):
        read_c3d(path)
    path.write_bytes(bytes(data).replace(scale, floats(np.inf)))
    with pytest.raises(InputError, match="scales its positions by inf"):
        read_c3d(path)


def test_data_that_begin_nowhere_are_refused(written):
    path, _ = written
    data = bytearray(path.read_bytes())
    struct.pack_into("<H", data, 16, 2)
    path.write_bytes(change(bytes(data), "DATA_START", struct.pack("<H", 2)))
    with pytest.raises(InputError, match="its data begin where they cannot"):
        read_c3d(path)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["A"], r"position is \(5, 4, 3\), \(time, 1, 3\) is wanted"),
        (["A", "B", "C", "A"], "a name comes more than once"),
        (["A", "B", "C", "x:D"], "the name 'x:D' cannot stand in such a file"),
        (["A", "B", "C", "D" * 128], "names of 127 bytes each at most"),
    ],
)
def test_wrong_arguments_of_the_writer_are_named(written, names, message):
    path, position = written
    with pytest.raises(ValueError, match=message):
        write_c3d(path, position, names, 60.0)
