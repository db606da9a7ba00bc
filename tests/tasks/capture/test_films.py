"""Tests of what the stages read of a capture: ranges of frames, films and masks."""

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.video import open_video, read_frames
from tasks.capture import films as capture_films
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, generate_performance

pytestmark = pytest.mark.compiled  # the films are rendered, which takes long interpreted

FRAMES = 21
RING = RingSettings(cameras=4, size=(80, 60), radius_m=3.5)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("films") / "dancer"
    track = generate_performance([okuri48()], TK, rate_hz=10.0).position[:FRAMES]
    cameras = generate_cameras(RING, center_m=(0.0, 0.9, 0.0), seed=4)
    film_capture(folder, track, 10.0, cameras=cameras, settings=FilmSettings(voxel_m=0.05))
    return read_capture(folder)


@pytest.mark.parametrize("held", [1, 5, 16])
def test_films_come_in_order_each_frame_once_however_they_are_cut(capture, held, monkeypatch):
    monkeypatch.setattr(capture_films, "_HELD_BYTES", held * 3 * 80 * 60 * 4)
    whole = [read_frames(open_video(path), 0, FRAMES) for path in capture.videos]
    parts = list(capture_films.read_films(capture, 3, 20))
    assert [first for first, _ in parts] == list(range(3, 20, held))
    for camera, film in enumerate(whole):
        together = np.concatenate([films[camera] for _, films in parts])
        np.testing.assert_array_equal(together, film[3:20])


def test_no_frame_is_read_of_an_empty_range(capture):
    assert list(capture_films.read_films(capture, 7, 7)) == []


def test_who_stops_reading_leaves_no_thread_behind(capture, monkeypatch):
    monkeypatch.setattr(capture_films, "_HELD_BYTES", 1)
    films = capture_films.read_films(capture, 0, FRAMES)
    assert next(films)[0] == 0
    films.close()
    assert list(films) == []


def test_the_camera_of_a_film_that_cannot_be_read_is_named(capture):
    def fails():
        raise InputError("nothing but noise")

    with pytest.raises(InputError, match="camera 'cam3': nothing but noise"):
        capture_films.of_camera(capture.cameras[2], fails)


@pytest.mark.parametrize("length", [8, 10, 21, 300])
def test_ranges_cover_every_frame_once(capture, length, monkeypatch):
    monkeypatch.setattr(capture_films, "_BLOCK_FRAMES", length)
    ranges = capture_films.block_ranges(capture)
    assert [n for start, end in ranges for n in range(start, end)] == list(range(FRAMES))
    assert all(end - start == length for start, end in ranges[:-1])
