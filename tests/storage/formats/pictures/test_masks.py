"""Masks of every kind say how much of a pixel is the performer; what is none is refused."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.pictures.masks import decode_mask
from storage.formats.pictures.video import open_masks, open_video, pick_frames, read_frames
from storage.formats.pictures.video_writing import write_video
from tests.figures.films import moving, write_film

ROWS, COLUMNS = 10, 13


@pytest.fixture
def rng():
    return np.random.default_rng(8)


@pytest.fixture
def mask():
    """A mask (row, column) of 0, 255 and a soft edge."""
    found = np.zeros((ROWS, COLUMNS), np.uint8)
    found[2:8, 3:9] = 255
    found[2:8, 9] = 100
    return found


def written(path, picture):
    assert cv2.imwrite(str(path), picture)
    return path


def test_white_is_the_performer_and_soft_edges_are_kept(mask, tmp_path):
    for picture in (mask, np.repeat(mask[..., None], 3, axis=2), mask.astype(np.uint16) * 257):
        np.testing.assert_array_equal(decode_mask(written(tmp_path / "a.png", picture)), mask)
    opaque = np.dstack([mask, mask, mask, np.full_like(mask, 255)])
    np.testing.assert_array_equal(decode_mask(written(tmp_path / "b.png", opaque)), mask)
    found = decode_mask(written(tmp_path / "c.jpg", mask))
    assert np.abs(found.astype(int) - mask).max() < 60
    assert found.shape == mask.shape


def test_of_a_performer_cut_out_the_opacity_counts(mask, tmp_path, rng):
    colors = rng.integers(0, 256, (ROWS, COLUMNS, 3), np.uint8)
    path = written(tmp_path / "a.png", np.dstack([colors, mask]))
    np.testing.assert_array_equal(decode_mask(path), mask)
    nobody = np.dstack([colors, np.zeros_like(mask)])
    assert not decode_mask(written(tmp_path / "b.png", nobody)).any()


def test_zeros_and_ones_of_a_program_are_black_and_white(mask, tmp_path):
    for kind in (np.uint8, np.uint16):
        path = written(tmp_path / "a.png", (mask > 200).astype(kind))
        np.testing.assert_array_equal(decode_mask(path), (mask > 200) * 255)


@pytest.mark.parametrize("kind", ["P1", "P4"])
def test_bitmaps_are_read_in_digits_and_in_bits(mask, tmp_path, kind):
    inside = mask > 200
    head = f"{kind}\n# made elsewhere\n{COLUMNS} {ROWS}\n".encode()
    if kind == "P1":
        rows = (" ".join("01"[int(not value)] for value in row) for row in inside)
        body = "\n".join(rows).encode()
    else:
        body = np.packbits(~inside, axis=1).tobytes()
    path = tmp_path / "a.pbm"
    path.write_bytes(head + body)
    np.testing.assert_array_equal(decode_mask(path), inside * 255)
    path.write_bytes(head + body[: len(body) // 2])
    with pytest.raises(InputError, match=r"a\.pbm cannot be decoded: it is damaged or no picture"):
        decode_mask(path)


@pytest.mark.parametrize("content", [b"", b"P4\n99999999 99999999\n", b"P5\n2 2\n255\nabcd", b"no"])
def test_what_is_no_mask_is_refused(tmp_path, content):
    path = tmp_path / "a.pbm"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.pbm"):
        decode_mask(path)


def test_a_film_of_masks_is_read_as_masks(tmp_path):
    frames = np.where(moving(9) > 180, 255, 0).astype(np.uint8)
    path = write_film(tmp_path / "cam1.mp4", frames, options={"crf": "10"})
    video = open_masks(path)
    found = read_frames(video, 0, 9)
    assert found.shape == frames.shape[:3]
    assert ((found >= 128) != (frames[..., 0] >= 128)).mean() < 0.002
    np.testing.assert_array_equal(read_frames(video, 4, 6), found[4:6])


def test_of_a_film_that_can_be_seen_through_the_opacity_counts(tmp_path, rng):
    opacity = rng.integers(0, 256, (4, 16, 24), np.uint8)
    with av.open(str(tmp_path / "cam1.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = 24, 16, "bgra"
        for each in opacity:
            colors = rng.integers(0, 256, (16, 24, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(np.dstack([colors, each]), format="rgba")
            container.mux(stream.encode(frame.reformat(format="bgra")))
        container.mux(stream.encode())
    np.testing.assert_array_equal(read_frames(open_masks(tmp_path / "cam1.mkv"), 0, 4), opacity)


def test_a_folder_of_masks_is_in_the_order_of_its_numbers(mask, tmp_path):
    for number in (9, 10, 11):
        written(tmp_path / f"{number}.png", np.roll(mask, number, axis=1))
    (tmp_path / "10.png").rename(tmp_path / "x10.png")
    video = open_masks(tmp_path)
    assert (video.frames, video.size) == (3, (ROWS, COLUMNS))
    wanted = np.stack([np.roll(mask, number, axis=1) for number in (9, 10, 11)])
    np.testing.assert_array_equal(read_frames(video, 0, 3), wanted)


@pytest.mark.parametrize("numbers", [[0], [3, 4, 29], [0, 7, 13, 14, 21], [29], []])
@pytest.mark.parametrize("how", ["often", "once", "pictures"])
def test_picked_frames_are_those_of_the_film(tmp_path, numbers, how):
    frames = moving(30, rows=32, columns=48)
    path = tmp_path / "cam1"
    if how == "pictures":
        path.mkdir()
        for n, frame in enumerate(frames):
            written(path / f"{n}.png", frame)
    else:
        path = path.with_suffix(".mp4")
        write_film(path, frames, options={"g": "10" if how == "often" else "99"})
    video = open_video(path)
    whole = read_frames(video, 0, 30)
    picked = list(pick_frames(video, numbers))
    assert len(picked) == len(numbers)
    for n, frame in zip(numbers, picked, strict=True):
        np.testing.assert_array_equal(frame, whole[n])


def test_a_film_that_is_cut_off_is_named(tmp_path):
    path = tmp_path / "cam1.mp4"
    write_video(path, list(np.repeat(moving(8), 2, axis=0)), 30.0)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(InputError, match=r"cam1\.mp4"):
        open_masks(path)
