"""A capture is read when it is whole, with masks or backgrounds; what is no fault is noted."""

import json
import shutil

import numpy as np
import pytest

from storage.formats.capture.capture import read_capture
from storage.formats.capture.capture_toml import Volume
from storage.formats.pictures.pictures import write_png
from storage.recordings import digest_capture
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, rig
from tests.storage.formats.capture.conftest import (
    FRAMES,
    TOML,
    edit,
    faults,
    film,
    gap_in_masks,
    gap_in_pictures,
    initial_of,
    with_masks,
)


def test_a_capture_that_is_right_is_read(folder):
    initial_of(FRAMES - 1)(folder)
    capture = read_capture(folder)
    assert capture.take == "okuri-48"
    assert capture.metadata == {"title": "Okuri 48", "recorded": "2026-03-02"}
    assert capture.stature_m == 1.58
    assert capture.volume == Volume((0.1, 1.0, -0.2), (1.6, 2.0, 1.2), 0.02)
    assert (capture.fps, capture.frames) == (30.0, FRAMES)
    assert [camera.name for camera in capture.cameras] == list(NAMES)
    assert capture.videos == tuple(folder / "videos" / f"{name}.mp4" for name in NAMES)
    assert capture.backgrounds == tuple(folder / "background" / f"{name}.png" for name in NAMES)
    assert capture.initial == folder / "initial.json"
    assert capture.calibration == folder / "calibration.toml"
    assert min(capture.seen_share) > 0.5
    (note,) = capture.notes
    assert note.startswith("The cameras see this much of the volume: 01 ")
    json.dumps(capture.metadata)


def test_the_take_may_be_named(folder):
    edit(folder, "[take]", '[take]\nid = "Bon Odori 2"')
    capture = read_capture(folder)
    assert capture.take == "bon-odori-2"
    assert "id" not in capture.metadata


def test_videos_may_be_folders_of_pictures_and_backgrounds_videos(folder):
    (folder / "videos" / "2.mp4").unlink()
    (folder / "videos" / "2").mkdir()
    for number in range(FRAMES):
        path = folder / "videos" / "2" / f"{number:04}.png"
        write_png(path, np.zeros((480, 640, 3), np.uint8))
    (folder / "background" / "side.png").unlink()
    film(folder / "background" / "side.mp4", frames=5)
    capture = read_capture(folder)
    assert capture.videos[1] == folder / "videos" / "2"
    assert capture.backgrounds[2] == folder / "background" / "side.mp4"
    assert capture.frames == FRAMES


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (files.write_easymocap, "extri.yml"),
        (files.write_opencv, "calibration"),
        (files.write_panoptic, "calibration.json"),
        (files.write_qualisys, "calibration.qca.txt"),
        (files.write_colmap, "cameras.txt"),
    ],
)
def test_every_format_of_calibration_is_found(folder, write, name):
    (folder / "calibration.toml").unlink()
    edit(folder, 'up = "y"', "")
    write(folder, rig())
    capture = read_capture(folder)
    assert capture.calibration.name in (name, "intri.yml")
    np.testing.assert_allclose(capture.cameras[1].center_m, rig()[1].center_m, atol=1e-6)


def test_a_calibration_without_image_sizes_takes_those_of_the_videos(folder):
    (folder / "calibration.toml").unlink()
    files.write_matrices(folder, rig(()))
    capture = read_capture(folder)
    assert [camera.size for camera in capture.cameras] == [(640, 480)] * 3
    assert "The calibration does not say image sizes: those of the videos were taken." in (
        capture.notes
    )


def test_a_video_of_another_size_than_a_silent_calibration_is_said(folder):
    (folder / "calibration.toml").unlink()
    files.write_matrices(folder, rig(()))
    film(folder / "videos" / "2.mp4", size=(240, 320))
    assert any("camera '2': its video is 240x320, but the calibration has" in fault
               for fault in faults(folder))  # fmt: skip


def test_masks_stand_for_backgrounds(folder):
    with_masks()(folder)
    gap_in_masks(folder)
    write_png(folder / "silhouettes/2/5.png", np.zeros((480, 640, 3), np.uint8))
    capture = read_capture(folder)
    assert capture.backgrounds == ()
    names = ("01.mp4", "2", "side.mp4")
    assert capture.masks == tuple(folder / "silhouettes" / name for name in names)


def test_of_masks_and_backgrounds_the_masks_are_taken_and_that_is_said(folder):
    before = read_capture(folder)
    shutil.copytree(folder / "background", folder / "kept")
    with_masks()(folder)
    (folder / "kept").rename(folder / "background")
    capture = read_capture(folder)
    assert (capture.backgrounds, len(capture.masks)) == ((), 3)
    [note] = set(capture.notes) - set(before.notes)
    assert note == (
        "The capture has masks in `silhouettes` and pictures in `background`: the masks were taken."
    )


def test_a_capture_is_read_without_either_and_what_is_missing_is_said_with_other_faults(folder):
    shutil.rmtree(folder / "background")
    capture = read_capture(folder)
    assert (capture.backgrounds, capture.masks) == ((), ())
    edit(folder, "1.58", "158")
    lines = faults(folder)
    assert len(lines) == 2
    assert lines[1].startswith("nothing tells the performer from the stage: there is no folder `ba")


def test_masks_are_content(folder):
    with_masks()(folder)
    before = digest_capture(folder)
    film(folder / "silhouettes/2.mp4", frames=FRAMES + 1)
    assert digest_capture(folder) != before


@pytest.mark.parametrize(
    ("spoil", "note"),
    [
        (lambda folder: film(folder / "videos/2.mp4", frames=11), "('2' 11, the others 12): the "
         "first 11 of each are used"),
        (gap_in_pictures, "The video of '2': 1 numbers are missing among the pictures"),
        (lambda folder: film(folder / "videos/x.mp4"), "The video of 'x' has no calibration: left"),
        (lambda folder: edit(folder, "fps = 30.0", ""), "has no fps: the videos' 30 was taken."),
        (lambda folder: edit(folder, "30.0", "60.0"), "The videos say 30 frames a second and capt"),
        (lambda folder: edit(folder, "fps", "pfs = 1\nfps"), "has 'video.pfs', which means"),
        (lambda folder: edit(folder, "[take]", "[tak]\n[take]"), "has 'tak', which means nothing"),
        (lambda folder: files.write_pose2sim(folder, rig(), scale=1000.0),
         "read as millimetres, which puts the cameras 3."),
    ],
)  # fmt: skip
def test_what_is_no_fault_is_noted(folder, spoil, note):
    spoil(folder)
    capture = read_capture(folder)
    assert any(note in said for said in capture.notes)
    assert capture.frames in (11, 12)


def test_a_unit_in_words_or_metres_is_taken(folder):
    for unit, scale in (('"mm"', 1000.0), ("0.03", 1 / 0.03)):
        files.write_pose2sim(folder, rig(), scale=scale)
        (folder / "capture.toml").write_text(TOML + f"unit = {unit}\n")
        cameras = read_capture(folder).cameras
        np.testing.assert_allclose(cameras[0].center_m, rig()[0].center_m, atol=1e-9)


@pytest.mark.data
@pytest.mark.parametrize("name", ["plain", "kimono", "spin", "martial"])
def test_the_rendered_captures_are_right(shared_data, name):
    capture = read_capture(shared_data / "captures" / name)
    assert (capture.take, capture.frames, capture.fps) == (name, 150, 30.0)
    assert len(capture.cameras) == len(capture.videos) == len(capture.backgrounds) == 8
    assert min(capture.seen_share) > 0.7
    unit, seen = capture.notes
    assert "read as metres" in unit
    assert "cam1" in seen
