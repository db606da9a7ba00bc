"""`shosa doctor CAPTURE` examines a small filmed capture, and names what was done to it."""

import dataclasses
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from flows.command.main import main
from storage.formats.calibration.toml import write_calibration
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video import VIDEO_SUFFIXES, open_video, read_frames
from tasks.checks.examination import _names_apart
from tasks.checks.pictures import draw_silhouette
from tasks.exporting.demonstration import write_recordings
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, demo_performances, generate_performance
from tests.conftest import swaying_body
from tests.figures.films import write_film

pytestmark = pytest.mark.compiled  # rendering and silhouettes of whole films


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    track = stretch_arms_first(swaying_body(3, 45), 30.0)
    cameras = generate_cameras(
        RingSettings(cameras=5, overhead=0), center_m=(0.0, 0.9, 0.0), seed=4
    )
    folder = tmp_path_factory.mktemp("filmed") / "sway"
    film_capture(folder, track, 30.0, cameras=cameras, settings=FilmSettings(), seed=2)
    return folder


@pytest.fixture(scope="module")
def truth(filmed):
    """The true silhouettes (time, camera, row, column)."""
    with np.load(filmed.with_name("sway_truth.npz")) as arrays:
        columns = arrays["mask_shape"][-1]
        return np.unpackbits(arrays["masks"], axis=-1, count=columns).astype(bool)


def bring_masks(capture, masks):
    """Put masks (time, camera, row, column) uint8 into a capture in place of its backgrounds."""
    shutil.rmtree(capture / "background")
    for c in range(masks.shape[1]):
        folder = capture / "silhouettes" / f"cam{c + 1}"
        folder.mkdir(parents=True)
        for n, mask in enumerate(masks[:, c]):
            cv2.imwrite(str(folder / f"{n}.png"), mask)


@pytest.fixture
def capture(filmed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(filmed, tmp_path / "in" / "sway")
    return tmp_path / "in" / "sway"


def film_of(capture, number):
    films = [each for each in capture.joinpath("videos").iterdir() if each.suffix in VIDEO_SUFFIXES]
    return sorted(films)[number]


@pytest.mark.slow
def test_the_films_of_the_demo_are_good(tmp_path, monkeypatch, capsys):
    """What a new user tries first; in it the performer moves toward a camera for two seconds."""
    monkeypatch.chdir(tmp_path)
    performances, _ = demo_performances()
    recordings = write_recordings(tmp_path / "demo", performances)
    [films] = (path for path in recordings.iterdir() if path.is_dir())
    assert main(["doctor", str(films)]) == 0, capsys.readouterr()


@pytest.mark.slow
def test_a_good_capture_is_reported_and_drawn_and_left_as_it_is(capture, capsys, tmp_path):
    before = sorted(capture.rglob("*"))
    assert main(["doctor", str(capture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("5 cameras, 105 frames at 30 Hz")
    rows = [line.split() for line in lines[2:7]]
    assert all(row[1] == "320x240" and int(row[4][:-1]) >= 90 for row in rows)
    assert lines[-1] == "ok"
    pictures = sorted((tmp_path / "sway-doctor").iterdir())
    assert [each.stem for each in pictures] == [row[0] for row in rows]
    assert cv2.imread(str(pictures[0])).shape == (480, 1280, 3)
    assert sorted(capture.rglob("*")) == before


@pytest.mark.slow
def test_a_camera_that_was_turned_is_refined_beside_the_capture(capture, capsys, tmp_path):
    path = capture / "calibration.toml"
    right = read_capture(capture).cameras
    turn = cv2.Rodrigues(np.radians([0.4, 1.2, 0.0]))[0]
    turned = [
        dataclasses.replace(
            each, rotation=turn @ each.rotation, translation=turn @ each.translation
        )
        if each.name == "cam2"
        else each
        for each in right
    ]
    write_calibration(path, turned)
    wrong = path.read_bytes()
    main(["doctor", str(capture), "--refine"])
    said = capsys.readouterr().out
    [line] = [line for line in said.splitlines() if re.match(r"cam2 +[\d.]+ +[\d.]+ +\d+ ", line)]
    before, after, _, by_deg = map(float, line.split()[1:])
    assert before > 2.0
    assert after < 0.6
    assert by_deg > 0.2  # who hardly moves cannot tell all of it from a move
    assert path.read_bytes() == wrong
    written = tmp_path / "sway-doctor" / "calibration.toml"
    assert f"refined cameras: {written.relative_to(tmp_path)}, in metres with y up" in said
    shutil.copy(written, path)
    found = [each.rotation @ right[0].rotation.T for each in read_capture(capture).cameras]
    for each, camera in zip(found, right, strict=True):  # as the others see it
        apart = cv2.Rodrigues(each @ found[0].T @ (camera.rotation @ right[0].rotation.T).T)[0]
        assert np.degrees(np.linalg.norm(apart)) < 0.8  # of 1.3


@pytest.mark.slow
def test_a_late_film_is_named_with_the_line_that_mends_it(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    capture = tmp_path / "okuri"
    track = generate_performance([okuri48()], TK, rate_hz=15.0).position
    ring = RingSettings(cameras=5, size=(160, 120), overhead=0)
    cameras = generate_cameras(ring, center_m=(0.0, 0.9, 0.0), seed=4)
    film_capture(capture, track, 30.0, cameras=cameras, settings=FilmSettings(voxel_m=0.03))
    film = film_of(capture, 1)
    frames = read_frames(open_video(film), 3, len(track))
    film.unlink()
    write_film(film.with_suffix(".mkv"), frames, "ffv1", pixels="bgr0")
    assert main(["doctor", str(capture)]) == 3
    said = capsys.readouterr().out
    [line] = re.findall(r"write `(offset_s = \{ \S+ = 0\.\d+ \})` under \[video\]", said)
    assert f"film of camera '{film.stem}' is " in said
    assert line.startswith(f"offset_s = {{ {film.stem} = 0.")
    assert 2.7 < 30 * float(line.split()[-2]) < 3.3
    rows = {row.split()[0]: row.split() for row in said.splitlines()[2:7]}
    assert float(rows[film.stem][-1]) == pytest.approx(3.0, abs=0.3)
    toml = capture / "capture.toml"
    toml.write_text(toml.read_text().replace("[video]", f"[video]\n{line}"))
    assert main(["doctor", str(capture)]) == 0
    said = capsys.readouterr().out
    assert f"note: By offset_s the take begins with frame 0 of '{film.stem}'; frame 3 of" in said
    assert said.splitlines()[-1] == "ok"


@pytest.mark.slow
def test_exchanged_films_stop_with_their_cameras_named(capture, capsys):
    first, second = film_of(capture, 0), film_of(capture, 3)
    for folder in ("videos", "background"):
        files = {each.stem: each for each in capture.joinpath(folder).iterdir()}
        one, other = files[first.stem], files[second.stem]
        kept = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(kept)
    assert main(["doctor", str(capture), "--out", "drawn"]) == 3
    said = capsys.readouterr().out
    assert f"BAD the films of camera '{first.stem}' and '{second.stem}' are exchanged" in said
    assert "ok" not in said.splitlines()


@pytest.mark.parametrize("how", ["cut", "text", "codec"])
def test_a_film_that_cannot_be_read_is_named_by_its_camera(capture, capsys, how):
    film = film_of(capture, 2)
    data = film.read_bytes()
    film.write_bytes({
        "cut": data[: len(data) * 2 // 3],
        "text": b"this is no film\n" * 400,
        "codec": data.replace(b"mp4v", b"zzz9").replace(b"esds", b"zzzz"),
    }[how])  # fmt: skip
    assert main(["doctor", str(capture)]) == 3
    said = capsys.readouterr().err
    assert f"camera '{film.stem}'" in said
    assert "copy it again" in said
    assert "Traceback" not in said


def test_a_film_that_breaks_in_the_middle_is_named_by_its_camera(capture, capsys):
    film = film_of(capture, 1)
    pictures = capture / "videos" / film.stem
    pictures.mkdir()
    reader = cv2.VideoCapture(str(film))
    for number in range(105):
        cv2.imwrite(str(pictures / f"{number:04d}.png"), reader.read()[1])
    reader.release()
    film.unlink()
    broken = pictures / "0030.png"
    broken.write_bytes(broken.read_bytes()[:50])
    assert main(["doctor", str(capture)]) == 3
    said = capsys.readouterr().err
    assert f"camera '{film.stem}'" in said
    assert "0030.png" in said


def test_every_capture_is_examined_and_one_fault_is_enough(capture, capsys, tmp_path):
    assert main(["doctor", str(tmp_path / "nowhere"), str(capture), "--out", "both"]) == 3
    heard = capsys.readouterr()
    assert "is no folder" in heard.err
    assert heard.out.splitlines()[-1] == "ok"
    assert len(list((tmp_path / "both" / "sway").iterdir())) == 5


def test_pictures_are_not_written_into_the_capture(capture, capsys):
    assert main(["doctor", str(capture), "--out", str(capture / "checks")]) == 3
    assert "is within the capture" in capsys.readouterr().err
    assert not (capture / "checks").exists()


@pytest.mark.slow
def test_where_nothing_can_be_written_the_table_comes_anyway(capture, capsys, tmp_path):
    (tmp_path / "sway-doctor").write_text("in the way, as a disk that is only read would be")
    assert main(["doctor", str(capture)]) == 0
    heard = capsys.readouterr()
    assert len(heard.out.splitlines()) >= 8
    assert heard.out.splitlines()[-1] == "ok"
    assert "pictures: none, they could not be written" in heard.out
    assert "the pictures cannot be written into sway-doctor" in heard.err
    assert "name a folder that can be written by --out" in heard.err
    assert main(["doctor", str(capture), "--out", str(tmp_path / "sway-doctor" / "in")]) == 3
    assert "ok" in capsys.readouterr().out.splitlines()


@pytest.mark.slow
def test_captures_of_one_name_have_folders_of_their_own(capture, capsys, tmp_path):
    other = tmp_path / "other" / "Sway"
    shutil.copytree(capture, other)
    assert main(["doctor", str(capture), str(other)]) == 0
    folders = [line for line in capsys.readouterr().out.splitlines() if "pictures: " in line]
    assert folders == ["pictures: sway-doctor", "pictures: other-Sway-doctor"]
    assert all(len(list((tmp_path / line[10:]).iterdir())) == 5 for line in folders)


@pytest.mark.slow
def test_masks_are_reported_as_what_was_found_is(capture, truth, capsys, tmp_path):
    bring_masks(capture, truth * np.uint8(255))
    assert main(["doctor", str(capture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    shares = [float(line.split()[3][:-1]) / 100 for line in lines[2:7]]
    frames = np.linspace(0, 104, 8).round().astype(int)
    np.testing.assert_allclose(shares, truth[frames].mean(axis=(0, 2, 3)), atol=0.0006)
    assert lines[-1] == "ok"
    assert len(list((tmp_path / "sway-doctor").iterdir())) == 5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda masks: 255 - masks, "are inverted: white, as the performer should be, is 9"),
        (lambda masks: masks * 0, "sees nobody in any of the frames looked at, and 0 cameras are"),
    ],
    ids=["inverted", "empty"],
)
def test_masks_that_cannot_be_right_are_never_ok(capture, truth, capsys, change, said):
    bring_masks(capture, change(truth * np.uint8(255)))
    assert main(["doctor", str(capture)]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert "ok" not in lines
    assert any(line.startswith("BAD ") and said in line for line in lines)


def test_a_capture_in_which_nothing_tells_the_performer_says_what_would(capture, capsys):
    shutil.rmtree(capture / "background")
    assert main(["doctor", str(capture)]) == 3
    assert 'write background = "film", or the key color of a screen' in capsys.readouterr().err
    (capture / "digitize.toml").write_text('[silhouettes]\nkey = "greenish"\n')
    assert main(["doctor", str(capture)]) == 3
    assert "silhouettes: key is 'greenish', it must be \"auto\" or a color" in (
        capsys.readouterr().err
    )


@pytest.mark.slow
@pytest.mark.parametrize("how", ['background = "film"', 'key = "auto"'])
def test_without_an_empty_stage_it_is_found_in_the_films(capture, truth, capsys, how):
    shutil.rmtree(capture / "background")
    (capture / "digitize.toml").write_text(f"[silhouettes]\n{how}\n")
    assert main(["doctor", str(capture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    shares = [float(line.split()[3][:-1]) / 100 for line in lines[2:7]]
    frames = np.linspace(0, 104, 8).round().astype(int)
    np.testing.assert_allclose(shares, truth[frames].mean(axis=(0, 2, 3)), atol=0.003)
    assert any("The backgrounds were found in the films" in line for line in lines)


@pytest.mark.slow
def test_a_performer_who_stands_in_the_backgrounds_is_named(capture, capsys):
    for number in range(5):
        film = film_of(capture, number)
        shown = read_frames(open_video(film), 70, 71)[0]
        write_png(capture / "background" / f"{film.stem}.png", shown)
    assert main(["doctor", str(capture)]) == 3
    said = capsys.readouterr().out
    assert "BAD the performer, or something that is not in the film, stands in the backgr" in said
    assert "ok" not in said.splitlines()


def test_names_of_captures_are_told_apart():
    folders = [Path(each) for each in ("/a/x", "/b/X", "/c/b-x", "/b/X", "/d/é", "/e/e\u0301")]
    assert _names_apart(folders) == ["x", "b-X", "c-b-x", "X-2", "é", "e-e\u0301"]


def test_the_outline_is_drawn_around_the_silhouette():
    frame = np.full((120, 160, 3), 90, np.uint8)
    silhouette = np.zeros((120, 160), bool)
    silhouette[40:80, 50:70] = True
    picture = draw_silhouette(frame, silhouette).astype(int)
    assert picture.shape == (480, 640, 3)
    red = picture[..., 0] - picture[..., 1] > 60
    assert red[160:320, 200].all()
    assert red[240, 190:215].any()
    assert not red[200:280, 210:270].any()
    assert not red[:150].any()
    with pytest.raises(ValueError, match="bring those of one camera"):
        draw_silhouette(frame, silhouette[:100])
