"""PLY files, read back by a parser that knows only the standard."""

import struct

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.pictures.ply import write_points, write_surface

SIZES = {"float": "f", "uchar": "B", "int": "i"}


def parse(data: bytes) -> tuple[dict[str, list[dict]], list[str]]:
    """Elements of a binary little-endian PLY, property by property, and its comments."""
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    elements, comments, at = [], [], 0
    for line in lines[2:]:
        match line.split():
            case ["comment", *_]:
                comments.append(line)
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", *kind, name]:
                elements[-1][2].append((name, kind))
    found: dict[str, list[dict]] = {}

    def take(kind):
        nonlocal at
        (value,) = struct.unpack_from("<" + SIZES[kind], body, at)
        at += struct.calcsize("<" + SIZES[kind])
        return value

    for name, count, properties in elements:
        for _ in range(count):
            row = {}
            for key, kind in properties:
                if kind[0] == "list":
                    row[key] = [take(kind[2]) for _ in range(take(kind[1]))]
                else:
                    row[key] = take(kind[0])
            found.setdefault(name, []).append(row)
    assert at == len(body)
    return found, comments


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def columns(rows, *names):
    return np.array([[row[name] for name in names] for row in rows])


def test_points_come_back_with_color_and_label(rng, tmp_path):
    center = rng.normal(size=(13, 3))
    color = rng.integers(0, 256, (13, 3)).astype(np.uint8)
    label = rng.integers(0, 12, 13).astype(np.uint8)
    write_points(tmp_path / "a.PLY", center, color, label)
    found, comments = parse((tmp_path / "a.PLY").read_bytes())
    assert set(found) == {"vertex"}
    assert comments == ["comment meters, right-handed, Y up, floor at y = 0"]
    place = columns(found["vertex"], "x", "y", "z")
    np.testing.assert_array_equal(place, center.astype(np.float32))
    np.testing.assert_array_equal(columns(found["vertex"], "red", "green", "blue"), color)
    np.testing.assert_array_equal(columns(found["vertex"], "label")[:, 0], label)


def test_a_surface_comes_back_with_color_and_faces(rng, tmp_path):
    vertex = rng.normal(size=(7, 3))
    color = rng.integers(0, 256, (7, 3)).astype(np.uint8)
    face = rng.integers(0, 7, (11, 3))
    face[0, 0] = 6
    write_surface(tmp_path / "a.ply", vertex, color, face)
    found, _ = parse((tmp_path / "a.ply").read_bytes())
    assert "label" not in found["vertex"][0]
    place = columns(found["vertex"], "x", "y", "z")
    np.testing.assert_array_equal(place, vertex.astype(np.float32))
    np.testing.assert_array_equal(columns(found["vertex"], "red", "green", "blue"), color)
    np.testing.assert_array_equal(columns(found["face"], "vertex_indices")[:, 0], face)


def test_nobody_is_a_file_without_points(tmp_path):
    none, colors = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    write_points(tmp_path / "a.ply", none, colors, np.zeros(0, np.uint8))
    write_surface(tmp_path / "b.ply", none, colors, np.zeros((0, 3), np.int32))
    assert parse((tmp_path / "a.ply").read_bytes())[0] == {}
    assert b"element face 0\n" in (tmp_path / "b.ply").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "b.ply"]


def test_arrays_that_do_not_fit_are_refused_all_at_once(tmp_path):
    center, color = np.zeros((5, 3)), np.zeros((5, 3), np.uint8)
    center[2, 1] = np.nan
    with pytest.raises(
        ValueError,
        match=r"not finite.*color is uint8 \(4, 3\), uint8 \(5, 3\) .*; label is int64 \(5,\)",
    ):
        write_points(tmp_path / "a.ply", center, color[:4], np.zeros(5, np.int64))
    with pytest.raises(ValueError, match=r"shape \(5,\), \(point, 3\) is wanted"):
        write_points(tmp_path / "a.ply", np.zeros(5), color, np.zeros(5, np.uint8))
    with pytest.raises(ValueError, match=r"vertices 0 to 5, but there are only 5"):
        write_surface(tmp_path / "a.ply", np.zeros((5, 3)), color, np.array([[0, 1, 5]]))
    with pytest.raises(ValueError, match=r"vertices -1 to 2"):
        write_surface(tmp_path / "a.ply", np.zeros((5, 3)), color, np.array([[0, -1, 2]]))
    with pytest.raises(ValueError, match=r"face is float64 \(2, 3\)"):
        write_surface(tmp_path / "a.ply", np.zeros((5, 3)), color, np.zeros((2, 3)))
    assert not list(tmp_path.iterdir())


def test_places_that_cannot_be_written_are_said(tmp_path):
    none, colors = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    with pytest.raises(InputError, match=r"a\.obj does not end in \.ply"):
        write_points(tmp_path / "a.obj", none, colors, np.zeros(0, np.uint8))
    with pytest.raises(InputError, match=r"cannot be written .*choose a folder"):
        write_points(tmp_path / "no" / "a.ply", none, colors, np.zeros(0, np.uint8))
