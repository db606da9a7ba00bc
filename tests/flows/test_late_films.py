"""A capture with a film that began late, and its offset, becomes the take that it would be."""

import shutil
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

from flows import chain
from storage import create_archive
from storage.blocks import read_block
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.video import open_video, read_frames
from storage.recordings import Recording, digest_capture
from tasks.capture import films as capture_films
from tasks.settings import Settings
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tests.conftest import swaying_body
from viewer.films import film_pictures, open_films

pytestmark = pytest.mark.slow

FRAMES, LATE = 14, 3


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A capture whose films are folders of pictures, which can be cut without a trace."""
    folder = tmp_path_factory.mktemp("films") / "dancer"
    track = stretch_arms_first(swaying_body(3, 30), 30.0)[:FRAMES]
    ring = RingSettings(cameras=5, size=(96, 72), radius_m=3.2)
    cameras = generate_cameras(ring, center_m=(0.0, 0.9, 0.0), seed=4)
    film_capture(folder, track, 30.0, cameras=cameras, settings=FilmSettings(voxel_m=0.04), seed=2)
    import cv2

    for film in sorted((folder / "videos").iterdir()):
        into = folder / "videos" / film.stem
        into.mkdir()
        frames = read_frames(open_video(film), 0, FRAMES)
        film.unlink()
        for n, frame in enumerate(frames):
            cv2.imwrite(str(into / f"{n:04d}.png"), frame[..., ::-1])
    return folder


def cut(capture, cameras):
    """Take the first pictures of some cameras away."""
    for camera in cameras:
        for picture in sorted((capture / "videos" / camera).iterdir())[:LATE]:
            picture.unlink()


def arrays_of(capture, folder, monkeypatch):
    """Every array that every stage writes, by its name, block after block."""
    monkeypatch.setattr(capture_films, "_BLOCK_FRAMES", 4)
    archive = create_archive(folder / f"{capture.name}-archive")
    source = read_capture(capture)
    recording = Recording(str(capture), digest_capture(capture), "dancer", {}, kind="capture")
    blocks, _ = chain.make_voxels(
        archive.location, recording, Settings(), tell=lambda *_: None,
        run=lambda function, **parameters: function(**parameters),
    )  # fmt: skip
    found = {
        (stage, name): [read_block(archive.place, each.block)[name] for each in parts]
        for stage, parts in blocks.items()
        for name in read_block(archive.place, parts[0].block)
    }
    return source, recording, found


def test_the_take_is_bit_for_bit_that_of_films_that_began_together(filmed, tmp_path, monkeypatch):
    cameras = [path.name for path in sorted((filmed / "videos").iterdir())]
    late, whole = (shutil.copytree(filmed, tmp_path / name) for name in ("late", "whole"))
    cut(late, cameras[1:2])
    cut(whole, cameras)  # the same moments, all films begun together
    text = (late / "capture.toml").read_text()
    assert "[video]" in text
    line = f"[video]\noffset_s = {{ {cameras[1]} = {LATE / 30:.4f} }}"
    (late / "capture.toml").write_text(text.replace("[video]", line))
    source, recording, found = arrays_of(late, tmp_path, monkeypatch)
    expected, other, wanted = arrays_of(whole, tmp_path, monkeypatch)
    assert source.first_frames == tuple(0 if name == cameras[1] else LATE for name in cameras)
    assert source.frames == expected.frames == FRAMES - LATE
    assert found.keys() == wanted.keys()
    for name, parts in found.items():
        for part, right in zip(parts, wanted[name], strict=True):
            np.testing.assert_array_equal(part, right, err_msg=str(name))
    assert [part.any() for part in found["silhouettes", "silhouette"]] == [True, True]
    # of the films as they were, the same frames but the first ones
    _, _, unshifted = arrays_of(filmed, tmp_path, monkeypatch)
    for name in ("silhouette",):
        before = np.concatenate(unshifted["silhouettes", name])[LATE:]
        np.testing.assert_array_equal(np.concatenate(found["silhouettes", name]), before)
    for stage, name in (("carving", "length"), ("coloring", "color")):
        ends = [np.concatenate([[0], np.cumsum(sizes)]) for sizes in _sizes(unshifted, stage)]
        first = int(ends[0][LATE])
        np.testing.assert_array_equal(
            np.concatenate(found[stage, name]), np.concatenate(unshifted[stage, name])[first:]
        )
    assert recording.digest != other.digest


def _sizes(arrays, stage):
    """How many runs or surface voxels each frame has."""
    yield np.concatenate([np.diff(offset) for offset in arrays[stage, "offset"]])


def test_another_offset_is_another_recording(filmed, tmp_path):
    capture = shutil.copytree(filmed, tmp_path / "dancer")
    toml = capture / "capture.toml"
    digests = [digest_capture(capture)]
    for seconds in ("0.1", "0.2"):
        toml.write_text(f"{(filmed / 'capture.toml').read_text()}\noffset_s.cam1 = {seconds}\n")
        digests.append(digest_capture(capture))
    assert len({*digests}) == 3
    assert all(one != other for one, other in pairwise(digests))


def test_the_films_beside_the_body_are_those_of_its_moments(filmed):
    """As the take was digitized, whatever stands in capture.toml now; none of before."""
    names = [camera.name for camera in read_capture(filmed).cameras]
    record = SimpleNamespace(source={"kind": "capture", "path": str(filmed)})

    def pictures(groups, camera):
        cameras = xarray.Dataset(groups, attrs={"cameras": names})
        films = open_films(SimpleNamespace(name="dancer", record=record, cameras=cameras))
        return film_pictures(films, 0, names[camera])

    first = {"first_frame": ("camera", [0, 5, *[0] * (len(names) - 2)])}
    assert pictures(first, 1)[0] == pictures({}, 1)[5]
    assert pictures(first, 0) == pictures({}, 0)
    assert len(pictures(first, 1)) == 8
