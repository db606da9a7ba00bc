"""A small capture that is right, and what changes a copy of it."""

import shutil

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.capture.capture import read_capture
from storage.formats.capture.initial import write_initial
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video_writing import write_video
from tasks.studio.dancing.openings import stretch_arms_first
from tests.conftest import swaying_body
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, rig

TOML = """
[take]
title = "Okuri 48"
recorded = 2026-03-02
stature_m = 1.58
[volume]
center_m = [0.1, 1.0, -0.2]
size_m = [1.6, 2.0, 1.2]
voxel_m = 0.02
[video]
fps = 30.0
up = "y"
"""
FRAMES = 12


def film(path, *, size=(640, 480), frames=FRAMES, rate_hz=30.0):
    frame = np.full((size[1], size[0], 3), 90, np.uint8)
    write_video(path, (frame for _ in range(frames)), rate_hz)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A small capture that is right: three cameras, 640 x 480, 12 frames."""
    folder = tmp_path_factory.mktemp("captures") / "Okuri 48!"
    (folder / "videos").mkdir(parents=True)
    (folder / "background").mkdir()
    (folder / "capture.toml").write_text(TOML)
    files.write_pose2sim(folder, rig(), metadata='unit = "m"\n')
    for name in NAMES:
        film(folder / "videos" / f"{name}.mp4")
        write_png(folder / "background" / f"{name}.png", np.full((480, 640, 3), 90, np.uint8))
    return folder


@pytest.fixture
def folder(whole, tmp_path):
    """A copy of it, to be spoiled."""
    return shutil.copytree(whole, tmp_path / "Okuri 48!")


def edit(folder, old, new, name="capture.toml"):
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


def faults(folder):
    """The lines of what is wrong, without the first."""
    with pytest.raises(InputError) as caught:
        read_capture(folder)
    head, *lines = str(caught.value).splitlines()
    assert head == f"{folder} cannot be used as a capture:"
    assert all(line.startswith("- ") for line in lines)
    return [line[2:] for line in lines]


def remove(name):
    def spoil(folder):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    return spoil


def initial_of(frame):
    return lambda folder: write_initial(
        folder / "initial.json", stretch_arms_first(swaying_body(0, 9), 30.0)[0], frame=frame
    )


def with_masks(spoil=None, *, size=(640, 480), frames=FRAMES):
    """Put masks into a capture in place of backgrounds, then spoil it."""

    def change(folder):
        shutil.rmtree(folder / "background")
        (folder / "silhouettes").mkdir()
        for name in NAMES:
            film(folder / "silhouettes" / f"{name}.mp4", size=size, frames=frames)
        if spoil:
            spoil(folder)

    return change


def gap_in_masks(folder):
    path = folder / "silhouettes" / "2"
    path.with_suffix(".mp4").unlink()
    path.mkdir()
    for number in (*range(5), *range(6, FRAMES)):
        write_png(path / f"{number}.png", np.zeros((480, 640, 3), np.uint8))


def gap_in_pictures(folder):
    (folder / "videos" / "2.mp4").unlink()
    (folder / "videos" / "2").mkdir()
    for number in (*range(5), *range(6, FRAMES + 1)):
        path = folder / "videos" / "2" / f"{number}.png"
        write_png(path, np.zeros((480, 640, 3), np.uint8))
