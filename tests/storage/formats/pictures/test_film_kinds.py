"""Films as cameras, phones and programs write them: interlaced, cut, old, damaged, anamorphic.

OpenCV, which read films before, is the second witness: of whole frames of eight bits both give the
same pixels.
"""

import os
import struct
from itertools import pairwise

import av
import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.pictures.combing import EVEN_FIRST, ODD_FIRST, order_of_fields
from storage.formats.pictures.video import (
    VIDEO_SUFFIXES,
    open_video,
    quiet_cv2,
    read_blocks,
    read_frames,
)
from tests.figures.films import moving, woven, write_film
from tests.storage.formats.pictures.test_video import FRAMES, MADE, number_of

INTERLACED = {"flags": "+ilme+ildct"}
X264 = {"crf": "18"}

CONTAINERS = {
    "mp4": ("libx264", "yuv420p"), "m4v": ("libx264", "yuv420p"), "mov": ("libx264", "yuv420p"),
    "3gp": ("libx264", "yuv420p"), "avi": ("mjpeg", "yuvj420p"), "mkv": ("ffv1", "yuv420p"),
    "webm": ("libvpx-vp9", "yuv420p"), "mts": ("libx264", "yuv420p"),
    "m2ts": ("libx264", "yuv420p"), "m2t": ("mpeg2video", "yuv420p"),
    "ts": ("libx264", "yuv420p"), "mpg": ("mpeg2video", "yuv420p"),
    "mpeg": ("mpeg1video", "yuv420p"), "vob": ("mpeg2video", "yuv420p"),
    "mod": ("mpeg2video", "yuv420p"), "tod": ("mpeg2video", "yuv420p"),
    "mxf": ("mpeg2video", "yuv420p"), "wmv": ("wmv2", "yuv420p"), "asf": ("wmv2", "yuv420p"),
    "flv": ("flv1", "yuv420p"),
}  # fmt: skip
"""A codec and kind of pixels for each container that FFmpeg writes; `dv` has a size of its own."""

WRITTEN_AS = {"m2t": "ts", "mod": "mpg", "tod": "ts", "ogv": "mkv"}
"""How FFmpeg's writer calls a container whose name it does not know."""


def witness(path):
    """Yield the frames as OpenCV reads them, RGB."""
    capture = quiet_cv2().VideoCapture(str(path), cv2.CAP_FFMPEG)
    while (read := capture.read())[0]:
        yield cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB)


def witnessed(path):
    """All frames as OpenCV reads them, RGB."""
    return np.array(list(witness(path)))


def whole(path):
    video = open_video(path)
    return video, read_frames(video, 0, video.frames)


def likeness_db(frames, others):
    """Peak signal to noise where the body is."""
    part = np.s_[:, 20:76, 10:118]
    return 10 * np.log10(255**2 / np.mean((frames[part].astype(float) - others[part]) ** 2))


COMBED = {
    "H.264, flagged": ("mp4", "libx264", "yuv420p", INTERLACED | X264 | {"x264-params": "ORDER=1"}),
    "H.264, not flagged": ("mp4", "libx264", "yuv420p", X264),
    "H.264 of a camcorder": (
        "mts", "libx264", "yuv420p", INTERLACED | X264 | {"x264-params": "ORDER=1"},
    ),
    "HEVC": ("mp4", "libx265", "yuv420p", {"x265-params": "interlace=ORDER:log-level=0"}),
    "MPEG-2": ("mpg", "mpeg2video", "yuv420p", INTERLACED | {"b": "4M"}),
    "ProRes": ("mov", "prores_ks", "yuv422p10le", INTERLACED),
    "MJPEG": ("avi", "mjpeg", "yuvj420p", {"q:v": "2"}),
    "FFV1": ("mkv", "ffv1", "yuv420p", {}),
}  # fmt: skip


@pytest.mark.parametrize("order", ["tff", "bff"])
@pytest.mark.parametrize("kind", COMBED)
def test_a_combed_film_is_read_as_whole_pictures_of_the_earlier_moment(tmp_path, kind, order):
    suffix, codec, pixels, options = COMBED[kind]
    options = {name: value.replace("ORDER", order) for name, value in options.items()}
    frames = moving(60)
    combed = woven(frames, order)
    path = tmp_path / f"film.{suffix}"
    video, found = whole(write_film(path, combed, codec, pixels=pixels, options=options, rate=25))
    assert (video.frames, video.rate_hz) == (30, 25.0)
    assert likeness_db(found, frames[::2]) > likeness_db(combed, frames[::2]) + 4.0
    assert likeness_db(found, frames[::2]) > likeness_db(found, frames[1::2]) + 4.0
    first = "even" if order == "tff" else "odd"
    assert (
        f"interlaced: each frame holds two moments, in even and in odd lines. It is read as one "
        f"whole picture of the earlier moment (that of the {first} lines" in " ".join(video.notes)
    )
    for start, end in ((0, 1), (7, 12), (13, 14), (28, 30), (29, 30), (30, 30)):
        np.testing.assert_array_equal(read_frames(video, start, end), found[start:end])


@pytest.mark.parametrize("suffix", ["avi", "mov", "dv"])
def test_dv_of_camcorders_is_read_and_only_what_is_combed_is_mended(tmp_path, suffix):
    frames = np.array([cv2.resize(frame, (720, 576)) for frame in moving(24)])
    for name, given in (("combed", woven(frames, "bff")), ("whole", frames[:12])):
        path = write_film(
            tmp_path / f"{name}.{suffix}", given, "dvvideo", pixels="yuv420p", rate=25
        )
        video = open_video(path)
        assert (video.frames, video.rate_hz, video.size) == (12, 25.0, (576, 720))
        assert video.fields == {"combed": "bff", "whole": ""}[name]
        assert video.pixel_aspect == pytest.approx(16 / 15)


def unflagged(path):
    """All frames of a film of YUV 4:2:0, converted without what is flagged."""
    frames = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            planes = [
                np.frombuffer(plane, np.uint8)
                .reshape(plane.height, plane.line_size)[:, : plane.width]
                .ravel()
                for plane in frame.planes
            ]
            bare = np.concatenate(planes).reshape(-1, frame.width)
            bare = av.VideoFrame.from_ndarray(bare, format="yuv420p")
            frames.append(bare.to_ndarray(format="rgb24"))
    return np.array(frames)


@pytest.mark.parametrize(
    ("suffix", "codec", "options"),
    [("mp4", "libx264", {"x264-params": "tff=1"}), ("mpg", "mpeg2video", {"b": "4M"}),
     ("mts", "libx264", {"x264-params": "bff=1"})],
)  # fmt: skip
def test_whole_frames_that_are_flagged_as_interlaced_are_read_as_they_are(
    tmp_path, suffix, codec, options
):
    frames = moving(20)
    frames[:, 48:, :, 0] //= 2  # colors, for of these a flag makes others
    path = write_film(tmp_path / f"film.{suffix}", frames, codec, options=INTERLACED | options)
    video, found = whole(path)
    assert (video.frames, video.fields) == (20, "")
    assert "says that it is interlaced, but no frame that moves holds two" in video.notes[0]
    np.testing.assert_array_equal(found, unflagged(path))


def test_neither_noise_nor_stripes_pass_for_combed(tmp_path):
    rng = np.random.default_rng(4)
    frames = moving(20)
    stripes = frames.copy()
    stripes[:, 1::2, :, :] //= 2
    noise = rng.integers(0, 256, frames.shape, np.uint8)
    noisy = np.clip(frames + rng.normal(0, 15, frames.shape), 0, 255).astype(np.uint8)
    for name, given in {"stripes": stripes, "noise": noise, "noisy": noisy}.items():
        path = write_film(tmp_path / f"{name}.mkv", given, "ffv1")
        video, found = whole(path)
        assert video.notes == ()
        np.testing.assert_array_equal(found, witnessed(path))


@pytest.mark.parametrize("suffix", CONTAINERS)
def test_every_container_is_read_as_opencv_reads_it(tmp_path, suffix):
    codec, pixels = CONTAINERS[suffix]
    written = tmp_path / f"film.{WRITTEN_AS.get(suffix, suffix)}"
    path = write_film(written, moving(40), codec, pixels=pixels, rate=25)
    path = path.rename(tmp_path / f"film.{suffix}")
    video, found = whole(path)
    assert (video.frames, video.rate_hz, video.size) == (40, 25.0, (96, 128))
    assert video.notes == ()
    np.testing.assert_array_equal(found, witnessed(path))
    for start in np.random.default_rng(3).permutation(40)[:20]:
        np.testing.assert_array_equal(read_frames(video, start, start + 1), found[start][None])


def test_every_kind_that_is_read_is_tried():
    assert {f".{suffix}" for suffix in CONTAINERS} | {".dv", ".ogv"} == set(VIDEO_SUFFIXES)


@pytest.mark.parametrize("size", [(95, 127), (96, 126), (97, 128)])
def test_films_of_odd_sizes_are_read_as_opencv_reads_them(tmp_path, size):
    frames = moving(5)[:, : size[0], : size[1]] if size[0] < 97 else moving(5, rows=97)
    path = write_film(tmp_path / "film.mp4", frames, "mpeg4")
    _, found = whole(path)
    assert found.shape[1:3] == size
    np.testing.assert_array_equal(found, witnessed(path))


def test_the_colors_of_ten_bits_are_not_smeared(tmp_path):
    """Both halve the color of rows and columns; what is left should come out alike."""
    frames = moving(10)
    frames[:, :48, :, 0] //= 2
    frames[..., 2] //= 2
    for codec, pixels in (("ffv1", "yuv420p10le"), ("libx264", "yuv420p10le")):
        path = write_film(tmp_path / f"{codec}.mkv", frames, codec, pixels=pixels, options=X264)
        _, found = whole(path)
        assert likeness_db(found, frames) > likeness_db(witnessed(path), frames)


def test_av1_is_read(tmp_path):
    frames = moving(12)
    options = {"svtav1-params": "tile-rows=0"}
    path = write_film(tmp_path / "film.mp4", frames, "libsvtav1", options=options)
    video, found = whole(path)
    assert video.frames == 12
    assert likeness_db(found, frames) > 25.0


@pytest.mark.parametrize("hidden", [1, 7, 12, 15, 40])
def test_frames_that_an_edit_list_hides_are_none(tmp_path, hidden):
    path = tmp_path / "cut.mp4"
    with (
        av.open(str(MADE / "b_frames.mp4")) as given,
        av.open(str(path), "w", options={"avoid_negative_ts": "disabled"}) as cut,
    ):
        stream = cut.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.size:
                packet.stream = stream
                packet.pts -= hidden * 3000
                packet.dts -= hidden * 3000
                cut.mux(packet)
    video, found = whole(path)
    assert [number_of(frame) for frame in found] == list(range(hidden, FRAMES))
    assert (video.rate_hz, video.notes) == (30.0, ())
    at = video.frames // 2
    np.testing.assert_array_equal(read_frames(video, at, at + 2), found[at : at + 2])


@pytest.mark.data
def test_the_reported_films_are_read(shared_data):
    video, found = whole(shared_data / "reports" / "R09" / "trimmed.mp4")
    assert (video.frames, video.notes) == (30, ())
    np.testing.assert_array_equal(found, witnessed(video.path))
    video, found = whole(shared_data / "reports" / "R05" / "flagged_interlaced.mp4")
    np.testing.assert_array_equal(found, unflagged(video.path))


@pytest.mark.long
@pytest.mark.data
@pytest.mark.slow
def test_recordings_are_read_as_opencv_reads_them(shared_data):
    films = sorted(shared_data.glob("captures/*/videos/*.mp4")) + sorted(
        shared_data.glob("rigs/*/*/*.avi")
    )
    assert len(films) > 50
    for path in films[::3]:
        video = open_video(path)
        assert video.fields == ""
        blocks = read_blocks([video], block=1)
        for (_, (found,)), frame in zip(blocks, witness(path), strict=True):
            assert np.array_equal(found[0], frame)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "mov"])
def test_a_title_in_another_encoding_is_none_of_our_business(tmp_path, suffix):
    path = tmp_path / f"film.{suffix}"
    write_film(path, moving(6), "mpeg4", metadata={"title": "TITLETITLE"})
    data = path.read_bytes()
    assert b"TITLETITLE" in data
    path.write_bytes(data.replace(b"TITLETITLE", "日本舞踊京".encode("cp932")))
    assert whole(path)[0].frames == 6


def test_a_file_name_that_is_not_utf_8_is_opened(tmp_path):
    path = write_film(tmp_path / "film.mp4", moving(6), "mpeg4")
    other = tmp_path / os.fsdecode("舞".encode("cp932") + b".mp4")
    path.rename(other)
    assert whole(other)[0].frames == 6


def read_or_none(path):
    """All frames of a film, or None where it was refused, with its name."""
    try:
        return whole(path)[1]
    except InputError as error:
        said = str(error)
    assert str(path) in said
    assert "\n" not in said
    return None


def test_a_film_that_lost_a_part_is_refused_and_no_picture_is_made_up(tmp_path):
    """A packet is taken out at each place of a broadcast film; OpenCV reads on without a word."""
    good = write_film(tmp_path / "good.ts", moving(40), "libx264", options={"g": "40", "bf": "0"})
    _, right = whole(good)
    data = good.read_bytes()
    path = tmp_path / "bad.ts"
    refused = 0
    for at in range(len(data) // 4 // 188 * 188, len(data) - 188, 3 * 188):
        path.write_bytes(data[:at] + data[at + 188 :])
        found = read_or_none(path)
        if found is None:
            refused += 1
            assert len(witnessed(path)) > 20
        else:
            np.testing.assert_array_equal(found, right)
    assert refused >= 5


@pytest.mark.parametrize("codec", ["libx264", "mpeg2video", "mpeg4"])
def test_a_film_with_bytes_changed_is_refused_or_has_all_its_frames(tmp_path, codec):
    rng = np.random.default_rng(8)
    data = write_film(tmp_path / "good.mp4", moving(30), codec).read_bytes()
    path = tmp_path / "bad.mp4"
    refused = 0
    for _ in range(20):
        at = int(rng.integers(len(data) // 5, len(data) * 4 // 5))
        path.write_bytes(data[:at] + rng.bytes(60) + data[at + 60 :])
        found = read_or_none(path)
        refused += found is None
        assert found is None or len(found) == 30
    assert refused >= 10


def test_pixels_that_are_not_square_are_said(tmp_path):
    path = write_film(tmp_path / "film.mp4", moving(6), "libx264", aspect="4/3")
    video = open_video(path)
    assert video.size == (96, 128)
    assert "128 x 96, where players show 171 x 96; the calibration has to be of" in video.notes[0]
    assert (
        open_video(write_film(tmp_path / "a.mp4", moving(6), "libx264", aspect="1/1")).notes == ()
    )


def test_lists_of_files_are_not_followed(tmp_path):
    write_film(tmp_path / "film.mp4", moving(6), "mpeg4")
    lists = {
        "a.ts": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfilm.mp4\n#EXT-X-ENDLIST\n",
        "b.mp4": "ffconcat version 1.0\nfile film.mp4\n",
    }
    for name, text in lists.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match="cannot be opened as a film"):
            open_video(tmp_path / name)


def test_a_file_without_pictures_is_named(tmp_path):
    path = tmp_path / "sound.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        sound.rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(InputError, match=r"holds no film \(only audio\); bring the file of the"):
        open_video(path)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "film.mp4")
    with pytest.raises(InputError, match=r"film.mp4 is no regular file, but a named pipe"):
        open_video(tmp_path / "film.mp4")


def test_a_film_that_says_that_it_is_huge_is_refused_before_it_is_decoded(tmp_path):
    path = write_film(tmp_path / "film.avi", moving(2), "rawvideo", pixels="bgr24")
    data = path.read_bytes()
    size = struct.pack("<Iii", 40, 128, -96)
    assert data.count(size) == 1
    path.write_bytes(data.replace(size, struct.pack("<Iii", 40, 16_000, -16_000)))
    with pytest.raises(InputError, match="says that its frames are 16000 x 16000, larger than any"):
        open_video(path)


def test_the_dates_of_a_film_ascend(tmp_path):
    video = open_video(write_film(tmp_path / "film.mts", moving(30), "libx264"))
    assert all(a < b for a, b in pairwise(video.dates))


def test_a_film_is_combed_only_where_three_pairs_more_lean_one_way_than_the_other():
    """The first three are of a film of whole frames at 120 Hz, in which little moved."""
    assert order_of_fields([0.586, -0.4341, 0.263]) == ""
    assert order_of_fields([0.586, 0.4341, 0.263]) == ODD_FIRST
    assert order_of_fields([-0.586, -0.4341, -0.3, -0.4, 0.1]) == EVEN_FIRST
    assert order_of_fields([0.586, 0.4341]) == ""
