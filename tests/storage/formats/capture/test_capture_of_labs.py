"""Captures as labs have them: stages far from the origin, Japanese names, links, other files."""

import os
import shutil
import struct
import tracemalloc
import unicodedata
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.calibration.reading import write_calibration
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.decoding import decode_picture, header_size
from storage.formats.pictures.pictures import write_png
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, looking_at, rig
from tests.storage.formats.capture.conftest import TOML, edit, film


def make(folder, cameras, write=files.write_pose2sim):
    """A capture of these cameras whose calibration does not say its unit."""
    (folder / "videos").mkdir(parents=True)
    (folder / "background").mkdir()
    (folder / "capture.toml").write_text(TOML)
    write(folder, cameras)
    for camera in cameras:
        film(folder / "videos" / f"{camera.name}.mp4", frames=2)
        write_png(folder / "background" / f"{camera.name}.png", np.zeros((480, 640, 3), np.uint8))
    return folder


@pytest.fixture
def folder(tmp_path):
    return make(tmp_path / "okuri", rig())


STAGE = (2.4, 1.0, 2.1)
"""The middle of a stage that lies 3 m from the origin of its calibration."""


def around_stage(names=NAMES, aim=STAGE):
    places = [(6.5, 1.6, 2.0), (1.0, 2.4, 6.1), (-1.2, 0.7, -1.0)]
    return [looking_at(name, where, aim) for name, where in zip(names, places, strict=True)]


@pytest.mark.parametrize(("scale", "unit"), [(1, "metres"), (100, "centi"), (1000, "milli")])
@pytest.mark.parametrize("sized", [True, False])
def test_a_tight_volume_far_from_the_origin_keeps_the_unit(tmp_path, scale, unit, sized):
    def write(folder, cameras):
        files.write_easymocap(folder, cameras, scale=scale, with_size=sized)

    folder = make(tmp_path / "far", around_stage(), write)
    edit(folder, "[0.1, 1.0, -0.2]", str(list(STAGE)))
    edit(folder, "[1.6, 2.0, 1.2]", "[0.8, 1.7, 0.7]")
    edit(folder, "0.02", "0.01")
    capture = read_capture(folder)
    assert any(f"does not say its unit: read as {unit}" in note for note in capture.notes)
    np.testing.assert_allclose(capture.cameras[0].center_m, (6.5, 1.6, 2.0), atol=1e-9)
    assert min(capture.seen_share) > 0.9


def test_a_unit_that_was_assumed_is_named_with_the_fault(tmp_path):
    folder = make(tmp_path / "away", around_stage(aim=(2.4, 60.0, 2.1)))
    with pytest.raises(InputError, match=r"not say its unit and was read in c?m: where that is wr"):
        read_capture(folder)
    edit(folder, 'up = "y"', 'up = "y"\nunit = "m"')
    with pytest.raises(InputError, match="do not see the volume") as caught:
        read_capture(folder)
    assert "not say its unit" not in str(caught.value)


def test_names_are_one_whether_composed_or_not(tmp_path):
    names = ["ガメラ1", "ガメラ2", "é"]
    cameras = [replace(c, name=n) for c, n in zip(rig(), names, strict=True)]
    folder = make(
        tmp_path / "two", cameras,
        lambda folder, cameras: write_calibration(folder / "calibration.toml", cameras),
    )  # fmt: skip
    for inside in ("videos", "background"):
        for path in list((folder / inside).iterdir()):
            path.rename(path.with_name(unicodedata.normalize("NFD", path.name)))
    assert [camera.name for camera in read_capture(folder).cameras] == names
    text = (folder / "calibration.toml").read_text()
    (folder / "calibration.toml").write_text(unicodedata.normalize("NFD", text))
    assert [camera.name for camera in read_capture(folder).cameras] == names
    shutil.copy(next((folder / "videos").glob("*1.mp4")), folder / "videos" / "ガメラ1.mp4")
    with pytest.raises(InputError, match="has more than one video"):
        read_capture(folder)


def test_a_backup_beside_the_calibration_is_left_out_with_a_word(folder):
    for name in ("calibration.toml.bak", "calibration.toml~", "._x.qca.txt"):
        shutil.copy(folder / "calibration.toml", folder / name)
    notes = read_capture(folder).notes
    assert "'calibration.toml.bak', 'calibration.toml~' is no calibration that is read: left out." \
        in notes  # fmt: skip
    (folder / "calibration.toml").unlink()
    with pytest.raises(InputError, match=r"there is no calibration.*\('calibration.toml.bak', '"):
        read_capture(folder)


def test_a_folder_that_means_nothing_is_named(folder):
    for name in ("masks", ".thumbnails", "calibration"):
        (folder / name).mkdir()
    with pytest.raises(InputError, match="more than one calibration"):
        read_capture(folder)
    (folder / "calibration").rmdir()
    [note] = [note for note in read_capture(folder).notes if "means nothing here" in note]
    assert note.startswith("The capture has the folder 'masks', which means nothing here")


def test_films_of_a_kind_that_is_not_read_are_named(folder):
    film_of_2 = folder / "videos" / "2.mp4"
    film_of_2.rename(film_of_2.with_suffix(".xyz"))
    with pytest.raises(InputError, match=r"'2' has no video.*; '2.xyz' is of no kind that is read"):
        read_capture(folder)


@pytest.mark.parametrize(
    "name",
    ["capture.toml", "calibration.toml", "videos/2.mp4", "background/2.png", "initial.json"],
)
def test_a_pipe_in_place_of_any_file_is_named(folder, name):
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    with pytest.raises(InputError, match=rf"{name} is no regular file, but a named pipe"):
        read_capture(folder)


def test_qualisys_cameras_that_have_a_film_count(tmp_path):
    folder = make(tmp_path / "qtm", rig(), files.write_qualisys)
    path = folder / "calibration.qca.txt"
    text = path.read_text()
    text = text.replace('serial="2" model="Miqus Video"', 'serial="2" model="Miqus Hybrid"')
    path.write_text(text.replace('serial="side" model="Miqus Video"', 'serial="side" model="M3"'))
    capture = read_capture(folder)
    assert [camera.name for camera in capture.cameras] == list(NAMES)
    assert "1 of the 4 cameras have no film: left out." in capture.notes
    (folder / "videos" / "2.mp4").unlink()
    capture = read_capture(folder)
    assert [camera.name for camera in capture.cameras] == ["01", "side"]
    (folder / "videos" / "01.mp4").unlink()
    with pytest.raises(InputError, match="camera '01' has no video"):
        read_capture(folder)


def test_a_stature_that_is_true_or_false_is_refused(folder):
    edit(folder, "1.58", "true")
    with pytest.raises(InputError, match=r"stature_m = True under .take. is no number of metres"):
        read_capture(folder)


@pytest.mark.parametrize("setting", ['up = ["y"]', "up = {y = 1}", "up = nan"])
def test_an_axis_that_is_no_text_is_refused(folder, setting):
    edit(folder, 'up = "y"', setting)
    with pytest.raises(InputError, match=r"up = .* under \[video\] is no axis"):
        read_capture(folder)


def test_metadata_that_are_not_finite_are_refused(folder):
    edit(folder, '"Okuri 48"', "{main = nan}")
    with pytest.raises(InputError, match=r"'title.main' in \[take\] of .* is not a finite number"):
        read_capture(folder)


def png_of(columns, rows):
    """A PNG of one bit a pixel, black: 50 kB for 400 million pixels."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(
            ">I", zlib.crc32(kind + data)
        )  # fmt: skip

    pack = zlib.compressobj(9)
    row = bytes(1 + (columns + 7) // 8)
    body = b"".join(pack.compress(row) for _ in range(rows)) + pack.flush()
    header = struct.pack(">IIBBBBB", columns, rows, 1, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
    )


def test_a_picture_that_is_far_too_large_is_refused_by_its_header(folder):
    path = folder / "background" / "2.png"
    path.write_bytes(png_of(20_000, 20_000))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"2.png is a picture of 20,000 x 20,000 pixels"):
            read_capture(folder)
        assert tracemalloc.get_traced_memory()[1] < 2e7
    finally:
        tracemalloc.stop()
    film_of_2 = folder / "videos" / "2"
    film_of_2.mkdir()
    (folder / "videos" / "2.mp4").unlink()
    path.rename(film_of_2 / "0.png")
    with pytest.raises(InputError, match=r"0.png is a picture of 20,000 x 20,000 pixels"):
        read_capture(folder)


@pytest.mark.parametrize("flags", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]])
def test_the_header_of_a_jpeg_tells_its_size(tmp_path, flags):
    picture = np.random.default_rng(1).integers(0, 255, (35, 52, 3), np.uint8)
    ok, data = cv2.imencode(".jpg", picture, flags)
    assert ok
    exif = b"\xff\xe1" + struct.pack(">H", 600) + b"\xff\xc0" * 299
    data = data.tobytes()[:2] + exif + b"\xff" + data.tobytes()[2:]
    assert header_size(data) == (52, 35)
    (tmp_path / "a.jpg").write_bytes(data)
    assert decode_picture(tmp_path / "a.jpg").shape == (35, 52, 3)
    at = data.index(b"\xff\xc2" if flags else b"\xff\xc0", 2 + len(exif))
    (tmp_path / "a.jpg").write_bytes(data[: at + 5] + b"\xff\xff\xff\xff" + data[at + 9 :])
    with pytest.raises(InputError, match="is a picture of 65,535 x 65,535 pixels"):
        decode_picture(tmp_path / "a.jpg")
    for end in range(0, len(data), 7):
        header_size(data[:end])
