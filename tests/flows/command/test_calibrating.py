"""`shosa calibrate`: drawn boards into a calibration that shosa reads, and what it refuses."""

import shutil

import cv2
import numpy as np
import pytest

from flows.command.main import main
from storage.formats.calibration.reading import read_calibration
from storage.formats.pictures.pictures import write_png
from tasks.calibration.boards import Board
from tasks.calibration.judging import why_unseen
from tasks.studio.dancing.choreography import walk
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import Performer, generate_performance
from tests.figures.board_pictures import board_poses, film_board, lying, ring
from tests.figures.films import write_film
from tests.tasks.calibration.test_solving import errors

CHECKERS = Board(6, 5, 0.13)
CHARUCO = Board(5, 3, 0.2, "DICT_4X4_50")


def poses_of(board, count=8):
    poses = board_poses(count, seed=2, spread=0.3, tilt=0.45)
    for pose in poses:
        pose[:3, 3] -= pose[:3, :3] @ board.middle_m
    return [*poses, lying(board)]


@pytest.fixture(scope="module")
def cameras():
    return ring(3, size=(360, 270), focal=320, radius=2.2, height=1.9, spread=0.45)


def filmed(board, cameras, poses):
    """What each camera films, by its name: (moment, row, column, 3)."""
    rng = np.random.default_rng(0)
    return {
        camera.name: np.array([film_board(board, camera, pose, rng=rng) for pose in poses])
        for camera in cameras
    }


@pytest.fixture(scope="module")
def checkers(cameras):
    return filmed(CHECKERS, cameras, poses_of(CHECKERS))


def write_pictures(folder, filmed):
    """A folder of pictures a camera, their names with its own; the last is of the floor."""
    for name, pictures in filmed.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(pictures[:-1]):
            write_png(folder / name / f"{name}_{number:02d}.png", picture)
        write_png(folder / name / "floor.png", pictures[-1])
    return folder


def calibrate(capsys, *arguments):
    code = main(["calibrate", *map(str, arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.slow
def test_pictures_become_a_calibration(tmp_path, capsys, cameras, checkers):
    folder = write_pictures(tmp_path / "boards", checkers)
    (folder / "calibration.toml").write_text("mine")
    code, out, err = calibrate(capsys, folder, "--square-m", 0.13)
    assert (code, out) == (3, "")
    assert "is there already; move it away, or replace it with --force" in err
    assert (folder / "calibration.toml").read_text() == "mine"

    code, out, err = calibrate(capsys, folder, "--square-m", 0.13, "--force")
    assert (code, err) == (0, "")
    assert out.startswith("checkerboard of 6x5 corners, squares of 130 mm\ncamera ")
    assert "BAD" not in out
    assert "Nothing says where the floor is" not in out
    found, notes = read_calibration(folder / "calibration.toml")
    assert notes == []
    assert [camera.name for camera in found] == ["cam1", "cam2", "cam3"]
    off = errors(found, cameras, CHECKERS)
    assert off[:, 0].max() < 25  # mm, of 2.4 m, in pictures of 360 x 270
    assert off[:, 1].max() < 0.6
    assert off[:, 2].max() < 1.0
    for camera in cameras:
        picture = cv2.imread(str(folder / "coverage" / f"{camera.name}.png"))
        assert picture.shape[1] >= 640
    # what there is to film again
    assert "note: Camera 'cam1' has" in out


@pytest.mark.slow
def test_feet_tell_the_floor(tmp_path, capsys):
    """Pictures without the floor, and a child who walks about before the cameras."""
    cameras = ring(4, size=(400, 300), focal=290, radius=2.6, height=1.1, spread=0.8)
    ways = [walk(4, turn=1.5), walk(4, turn=2.0), walk(4, turn=2.0)]
    child = generate_performance(ways, Performer("child", 1.0), rate_hz=4.0, place_m=(-0.3, -0.3))
    film_capture(tmp_path / "walk", child.position, 4.0, cameras=cameras, settings=FilmSettings())
    boards = filmed(CHECKERS, cameras, poses_of(CHECKERS))
    folder = write_pictures(tmp_path / "boards", boards)
    for camera in cameras:
        (folder / camera.name / "floor.png").unlink()
    (tmp_path / "walk" / "videos").rename(folder / "feet")
    code, out, err = calibrate(capsys, folder, "--square-m", 0.13)
    assert (code, err) == (0, ""), out
    assert "note: The floor is where somebody walked in" in out
    assert "Nothing says where the floor is" not in out
    found, _ = read_calibration(folder / "calibration.toml")
    for mine, true in zip(found, cameras, strict=True):
        up_off = mine.rotation[:, 1] @ true.rotation[:, 1]
        assert np.degrees(np.arccos(min(up_off, 1.0))) < 1.5
        assert mine.center_m[1] == pytest.approx(true.center_m[1], abs=0.06)

    (folder / "feet" / "cam1.mp4").rename(folder / "feet" / "cam9.mp4")
    code, out, err = calibrate(capsys, folder, "--square-m", 0.13, "--force")
    assert (code, out) == (3, "")
    assert "feet holds films of 'cam9', and the cameras are 'cam1', 'cam2', 'cam3', 'cam4'" in err


@pytest.mark.long
@pytest.mark.slow
def test_films_and_offsets_become_a_calibration(tmp_path, capsys, cameras):
    two = cameras[:2]
    poses = poses_of(CHARUCO)
    films = filmed(CHARUCO, two, poses)
    films["cam2"] = films["cam2"][1:]  # began one frame late
    for name, frames in films.items():
        write_film(tmp_path / f"{name}.mkv", frames, codec="ffv1", pixels="yuv444p", rate=5)
    (tmp_path / "capture.toml").write_text("[video]\noffset_s = { cam2 = 0.2 }\n")
    code, out, _ = calibrate(
        capsys, tmp_path, "--square-m", 0.2, "--floor-frame", f"cam1:{len(poses) - 1}"
    )
    assert code == 0
    assert "ChArUco board of 5x3 corners" in out
    found, _ = read_calibration(tmp_path / "calibration.toml")
    off = errors(found, two, CHARUCO)
    assert off[:, 0].max() < 40
    assert off[:, 1].max() < 1.0


def test_the_side_of_a_square_is_asked_for(tmp_path, capsys, checkers):
    folder = write_pictures(tmp_path, checkers)
    code, out, err = calibrate(capsys, folder)
    assert (code, out) == (2, "")
    assert "the board is a checkerboard of 6x5 corners; how large are its squares?" in err
    assert "--square-m 0.03" in err


@pytest.mark.long
@pytest.mark.slow
def test_a_wrong_size_is_told_with_the_right_one(tmp_path, capsys, checkers):
    folder = write_pictures(tmp_path, checkers)
    code, _, err = calibrate(capsys, folder, "--square-m", 0.13, "--board", "5x4")
    assert code == 3
    assert "the board in the pictures has 6x5 corners, and 5x4 were given: give --board 6x5" in err
    code, _, err = calibrate(capsys, folder, "--square-m", 0.13, "--board", "7x6")
    assert code == 3
    assert "the board in the pictures has 6x5 corners, and 7x6 were given (corners between" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--board", "9"], "--board 9 should be corners between squares, such as 9x6"),
        (["--square-m", "-1"], "--square-m -1 should be metres"),
        (["--floor-frame", "3"], "--floor-frame 3 should be CAMERA:FRAME"),
        (["--floor-frame", "cam9:3"], "a camera 'cam9', and there are 'cam1', 'cam2', 'cam3'"),
        (["--floor-frame", "cam1:77"], "a picture '77' of camera 'cam1', which has '00', '01'"),
    ],
)
def test_options_that_mean_nothing_are_refused(tmp_path, capsys, checkers, options, words):
    write_pictures(tmp_path, {name: pictures[:3] for name, pictures in checkers.items()})
    code, out, err = calibrate(capsys, tmp_path, "--square-m", "0.13", *options)
    assert (code, out) == (2, "")
    assert words in err


def test_all_faults_of_the_files_are_named_at_once(tmp_path, capsys, checkers):
    folder = write_pictures(tmp_path, {"cam1": checkers["cam1"][:2]})
    (folder / "cam2.mp4").write_bytes(b"no film")
    (folder / "cam1.avi").write_bytes(b"")
    (folder / "floor").mkdir()
    shutil.copy(folder / "cam1" / "floor.png", folder / "floor" / "other.png")
    (folder / "capture.toml").write_text("[video]\noffset_s = { cam7 = 1 }\n")
    code, _, err = calibrate(capsys, folder, "--square-m", 0.13)
    assert code == 3
    for words in (
        "cam2.mp4",
        "cam1.avi is empty",
        "other.png is of no camera",
        "offset_s of 'cam7'",
    ):
        assert words in err
    code, _, err = calibrate(capsys, tmp_path / "none", "--square-m", 0.13)
    assert code == 3
    assert "none is no folder" in err
    (tmp_path / "empty").mkdir()
    code, _, err = calibrate(capsys, tmp_path / "empty", "--square-m", 0.13)
    assert code == 3
    assert "holds no film and no pictures" in err


def test_pictures_without_a_board_are_refused(tmp_path, capsys, checkers):
    blank = {name: np.full_like(pictures[:2], 120) for name, pictures in checkers.items()}
    code, _, err = calibrate(capsys, write_pictures(tmp_path, blank), "--square-m", 0.13)
    assert code == 3
    assert "no checkerboard or ChArUco board is found" in err


@pytest.mark.slow
def test_what_is_wrong_with_each_camera_is_named(tmp_path, capsys, checkers):
    """A board that is never whole, and pictures of two sizes: at once, and nothing is written."""
    cut = checkers["cam2"][:5].copy()
    for picture in cut:
        bright = np.argwhere(picture[..., 0] > 160)
        picture[:, int(np.percentile(bright[:, 1], 55)) :] = 110
    write_pictures(tmp_path, {"good": checkers["cam2"][:5], "cut": cut})
    write_pictures(tmp_path, {"sizes": checkers["cam1"][:2]})
    write_png(tmp_path / "sizes" / "other.png", checkers["cam1"][0][:-10])
    code, out, _ = calibrate(capsys, tmp_path, "--square-m", 0.13)
    assert code == 3
    head = "BAD camera 'cut': the checkerboard of 6x5 corners is found in none of 5 pictures: "
    assert f"{head}it is never whole, at most" in out
    assert (
        "BAD camera 'sizes' has pictures of different sizes: floor.png is 360x270, other.png is"
        in out
    )
    assert "no calibration was written" in out
    assert not (tmp_path / "calibration.toml").exists()
    assert (tmp_path / "coverage" / "cut.png").exists()


def test_a_board_that_is_too_small_is_told(checkers):
    small = [
        cv2.copyMakeBorder(
            cv2.resize(picture[..., 0], None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA),
            *(60, 60, 80, 80), cv2.BORDER_CONSTANT, value=110,
        )
        for picture in checkers["cam2"][:3]
    ]  # fmt: skip
    said = why_unseen("small", small, CHECKERS, 3)
    assert "camera 'small': the checkerboard of 6x5 corners is found in none of 3 pictures" in said
    assert "it is too small, its squares have 4 px from side to side; hold it nearer" in said


@pytest.mark.slow
@pytest.mark.long
def test_mirrored_pictures_of_markers_are_told(tmp_path, capsys, cameras):
    films = filmed(CHARUCO, cameras[1:2], poses_of(CHARUCO)[:3])
    mirrored = {name: pictures[:, :, ::-1].copy() for name, pictures in films.items()}
    code, _, err = calibrate(capsys, write_pictures(tmp_path, mirrored), "--square-m", 1)
    assert code == 3
    assert "the pictures are mirrored; film without mirroring" in err
    [gray, *_] = mirrored["cam2"][..., 0]
    said = why_unseen("other", [np.ascontiguousarray(gray)], CHARUCO, 1)
    assert "camera 'other': the ChArUco board of 5x3 corners" in said
    assert "but in their mirror images: film without mirroring" in said
