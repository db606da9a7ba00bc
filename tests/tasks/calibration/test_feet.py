"""The floor from feet: of drawn steps, and of films of somebody who walks."""

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.calibration.reading import read_calibration
from storage.formats.capture.capture import read_capture
from tasks.calibration import feet
from tasks.calibration.feet import stand_on_floor, walkers_of
from tasks.calibration.floors import floor_of_steps
from tasks.capture.films import projection_of
from tasks.geometry.projection import project_points
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import walk
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import Performer, generate_performance

NAMES = ("cam1", "cam2", "cam3", "cam4")


def degrees_between(one, other):
    return np.degrees(np.arccos(np.clip(one @ other, -1, 1)))


def test_steps_tell_the_plane_though_some_are_in_the_air():
    rng = np.random.default_rng(0)
    up = np.array([0.1, 1.0, -0.15]) / np.linalg.norm([0.1, 1.0, -0.15])
    flat = rng.normal(size=(40, 3)) * 0.8
    steps = flat - np.outer(flat @ up, up) + 0.3 * up + 0.003 * rng.normal(size=(40, 1)) * up
    steps[::8] += np.outer(rng.uniform(0.1, 0.6, 5), up)
    floor = floor_of_steps(steps, np.array([0.0, 1.0, 0.0]))
    assert degrees_between(floor.up, up) < 0.2
    assert floor.middle @ up == pytest.approx(0.3, abs=0.004)
    assert np.degrees(floor.error) < 0.2


@pytest.mark.parametrize("noise_m", [0.004, 0.012])
def test_the_error_that_is_told_is_as_large_as_the_one_that_is_made(noise_m):
    rng, up = np.random.default_rng(1), np.array([0.0, 1.0, 0.0])
    off, told = [], []
    for _ in range(60):
        steps = rng.normal(size=(30, 3)) * [0.8, 0.0, 0.3] + noise_m * rng.normal(size=(30, 1)) * up
        floor = floor_of_steps(steps, up)
        off.append(np.arcsin(np.clip(floor.up[2], -1, 1)))  # about the longer side: the worse one
        told.append(floor.error)
    assert 0.6 < np.median(told) / np.std(off) < 1.7


def test_the_middle_of_a_walker_is_where_the_rays_through_silhouettes_meet():
    ring = RingSettings(cameras=4, size=(160, 120))
    projection = projection_of(generate_cameras(ring, center_m=(0.0, 0.9, 0.0), seed=1))
    place = np.array([0.5, 1.3, -0.4])
    pixel, _ = project_points(place[None], projection)
    silhouettes = np.zeros((4, 120, 160), np.uint8)
    for picture, at in zip(silhouettes, np.rint(pixel[:, 0]).astype(int), strict=True):
        cv2.circle(picture, tuple(at.tolist()), 5, 1, cv2.FILLED)
    found = feet._middle(silhouettes.view(bool), projection)
    assert np.linalg.norm(found - place) < 0.03  # a pixel is 0.03 m there
    silhouettes[1:] = 0
    assert feet._middle(silhouettes.view(bool), projection) is None


def film(folder, ways, *, cameras):
    """A capture of somebody who walks, three frames a second."""
    track = generate_performance(ways, Performer("walker", 1.5), rate_hz=3.0, place_m=(-0.5, -0.5))
    ring = generate_cameras(RingSettings(cameras=cameras, size=(240, 180)))
    film_capture(folder, track.position, 3.0, cameras=ring, settings=FilmSettings())


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """The capture of a walk all over a stage."""
    folder = tmp_path_factory.mktemp("walked") / "capture"
    film(
        folder,
        [walk(5, turn=1.2), walk(6, turn=2.2), walk(6, turn=1.8), walk(6, turn=2.0)],
        cameras=4,
    )
    return read_capture(folder)


@pytest.fixture
def boards(tmp_path, walked):
    """The folder of a calibration with the films of the walk in `feet`."""
    (tmp_path / "feet").mkdir()
    for camera, video in zip(walked.cameras, walked.videos, strict=True):
        (tmp_path / "feet" / f"{camera.name}{video.suffix}").symlink_to(video)
    return tmp_path


def astray(cameras, turn, shift):
    """The cameras in a world that is turned and moved."""
    world = cv2.Rodrigues(np.array(turn))[0]
    return [
        replace(
            each,
            rotation=each.rotation @ world.T,
            translation=each.translation - each.rotation @ world.T @ shift,
        )
        for each in cameras
    ]


@pytest.mark.slow
def test_a_walk_tells_the_floor(boards, walked):
    guessed = astray(walked.cameras, (0.08, 0.0, -0.06), np.array([0.4, -1.3, 2.0]))
    footage, notes = walkers_of(boards, NAMES)
    assert notes == []
    found, said = stand_on_floor(guessed, footage)
    for mine, true in zip(found, walked.cameras, strict=True):
        assert degrees_between(mine.rotation[:, 1], true.rotation[:, 1]) < 0.5
        assert mine.center_m[1] == pytest.approx(true.center_m[1], abs=0.04)
        assert np.allclose(mine.rotation @ mine.rotation.T, np.eye(3))
    assert distances(found) == pytest.approx(distances(walked.cameras))
    turned = float(said.split("up is ")[1].split(" degrees")[0])
    assert turned == pytest.approx(np.degrees(np.hypot(0.08, 0.06)), abs=0.5)


def distances(cameras):
    """How far each camera is from the next."""
    return [np.linalg.norm(a.center_m - b.center_m) for a, b in itertools.pairwise(cameras)]


@pytest.mark.slow
def test_who_walks_straight_on_tells_no_floor(tmp_path):
    film(tmp_path / "capture", [walk(7)], cameras=3)
    (tmp_path / "capture" / "videos").rename(tmp_path / "feet")
    footage, _ = walkers_of(tmp_path, NAMES[:3])
    cameras = read_calibration(tmp_path / "capture" / "calibration.toml")[0]
    with pytest.raises(
        InputError, match=r"does not tell the floor: .* film somebody who walks all"
    ):
        stand_on_floor(cameras, footage)


@pytest.mark.slow
def test_films_without_a_walker_are_refused(boards, walked):
    for path in (boards / "feet").iterdir():
        path.unlink()
    for name in NAMES:
        (boards / "feet" / name).mkdir()
        for moment in range(12):
            blank = np.full((180, 240, 3), 90, np.uint8)
            cv2.imwrite(str(boards / "feet" / name / f"{moment:02d}.png"), blank)
    footage, _ = walkers_of(boards, NAMES)
    with pytest.raises(InputError, match="who walks is found in 0 of 12 moments"):
        stand_on_floor(walked.cameras, footage)


def test_films_that_cannot_be_used_are_named(boards, walked):
    with pytest.raises(InputError, match=r"films of 'cam4', and the cameras are .*; rename"):
        walkers_of(boards, NAMES[:3])
    footage, _ = walkers_of(boards, NAMES)
    other = [replace(each, size=(320, 240)) for each in walked.cameras]
    with pytest.raises(InputError, match="are 240x180, and those of the board 320x240"):
        stand_on_floor(other, footage)
    for name in NAMES[2:]:
        next((boards / "feet").glob(f"{name}.*")).unlink()
    with pytest.raises(InputError, match="films of 2 cameras; 3 that see the same place"):
        walkers_of(boards, NAMES)
    assert walkers_of(boards / "feet", NAMES) == ([], [])
