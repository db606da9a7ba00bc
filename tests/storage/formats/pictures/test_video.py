"""Films are read to the frame, whatever the container, the codec and the place in the film.

Every generated frame carries its number in eight blocks of black and white. `videos/` was made
with PyAV 18 (libx264, a key frame every 12 frames, 3 B-frames, 30 Hz, 48 x 32):
what OpenCV cannot write.
"""

import re
import struct
import threading
import tracemalloc
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video import open_video, quiet_cv2, read_blocks, read_frames
from storage.formats.pictures.video_writing import write_video

MADE = Path(__file__).parent / "videos"
ROWS, COLUMNS, FRAMES = 32, 48, 60
WRITTEN = [("mp4v", "mp4"), ("MJPG", "avi"), ("XVID", "avi"), ("FFV1", "mkv"), ("mp4v", "mov")]


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def numbered(number):
    """A frame that shows its number in blocks of black and white, red on top, blue below."""
    frame = np.full((ROWS, COLUMNS, 3), 90, np.uint8)
    for bit in range(8):
        row, column = divmod(bit, 4)
        value = 235 if number >> bit & 1 else 16
        frame[16 * row + 2 : 16 * row + 14, 12 * column + 2 : 12 * column + 10] = value
    return frame


def number_of(frame):
    bits = [frame[16 * (bit // 4) + 8, 12 * (bit % 4) + 6].mean() > 120 for bit in range(8)]
    return sum(1 << bit for bit in range(8) if bits[bit])


def written(path, code="mp4v", frames=FRAMES, rate_hz=30.0):
    quiet_cv2()
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), rate_hz, (COLUMNS, ROWS))
    assert writer.isOpened()
    for number in range(frames):
        writer.write(numbered(number))
    writer.release()
    return path


def turned(data, matrix):
    """The bytes of an MP4 whose picture is to be shown through another matrix."""
    at = data.index(b"tkhd") + 44
    return data[:at] + struct.pack(">9i", *matrix) + data[at + 36 :]


def film(tmp_path, name):
    code, suffix = name.split(".")
    known = MADE / name
    return known if known.exists() else written(tmp_path / f"film.{suffix}", code)


FILMS = [f"{code}.{suffix}" for code, suffix in WRITTEN]
FILMS += ["b_frames.mp4", "b_frames.mkv", "b_frames.avi", "open_gop.mp4"]


@pytest.mark.parametrize("name", FILMS)
def test_every_frame_is_where_its_number_says_however_it_is_asked_for(tmp_path, rng, name):
    video = open_video(film(tmp_path, name))
    assert (video.frames, video.size, video.rate_hz) == (FRAMES, (ROWS, COLUMNS), 30.0)
    whole = read_frames(video, 0, FRAMES)
    assert [number_of(frame) for frame in whole] == list(range(FRAMES))
    for start in rng.permutation(FRAMES)[:25]:
        end = min(start + int(rng.integers(0, 9)), FRAMES)
        np.testing.assert_array_equal(read_frames(video, int(start), end), whole[start:end])


def test_a_film_whose_packets_have_no_dates_is_read_from_its_beginning_and_says_so():
    video = open_video(MADE / "b_frames.avi")
    assert not video.keys
    assert "does not say when each frame is shown" in video.notes[0]


class Container:
    """An open film, to be spoiled."""

    def __init__(self, real):
        self.real = real

    def __getattr__(self, name):
        return getattr(self.real, name)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.real.close()


def test_a_seek_that_lands_behind_its_frame_is_not_believed(monkeypatch):
    video = open_video(MADE / "b_frames.mp4")
    sought = []

    class Skipping(Container):
        """A film whose seeks land a key frame too late."""

        def seek(self, offset, **options):
            sought.append(offset)
            self.real.seek(offset + 12 * 3000, **options)

    real = av.open
    monkeypatch.setattr(av, "open", lambda *names, **options: Skipping(real(*names, **options)))
    assert [number_of(frame) for frame in read_frames(video, 37, 41)] == [37, 38, 39, 40]
    assert sought == [36 * 3000, 24 * 3000]


def test_a_frame_that_the_decoder_drops_is_noticed(monkeypatch):
    video = open_video(MADE / "b_frames.mp4")

    class Dropping(Container):
        """A film of which the sixth frame is not decoded."""

        def demux(self, stream):
            return (packet for packet in self.real.demux(stream) if packet.pts != 5 * 3000)

    real = av.open
    monkeypatch.setattr(av, "open", lambda *names, **options: Dropping(real(*names, **options)))
    assert len(read_frames(video, 0, 5)) == 5
    with pytest.raises(InputError, match=r"frame 5 of .* is missing or out of order"):
        read_frames(video, 0, 9)


def test_colors_are_rgb(tmp_path):
    frame = np.zeros((32, 48, 3), np.uint8)
    frame[..., 0] = 220
    write_video(tmp_path / "red.mp4", [frame] * 3, 25.0)
    write_png(tmp_path / "1.png", frame)
    for path in (tmp_path / "red.mp4", tmp_path):
        read = read_frames(open_video(path), 0, 1)[0]
        assert read[..., 0].min() > 180
        assert read[..., 1:].max() < 40


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("block", [1, 7, 100])
def test_several_films_are_read_side_by_side(tmp_path, block, workers):
    other = written(tmp_path / "short.mp4", frames=50)
    videos = [open_video(MADE / "b_frames.mp4"), open_video(other)]
    seen = []
    for start, frames in read_blocks(videos, block=block, start=3, workers=workers):
        assert start == 3 + len(seen)
        numbers = [[number_of(frame) for frame in film] for film in frames]
        assert numbers[0] == numbers[1]
        seen += numbers[0]
    assert seen == list(range(3, 50))


def test_memory_is_bounded_whatever_the_length(tmp_path):
    peaks = []
    for frames in (64, 192):
        video = open_video(written(tmp_path / f"{frames}.mp4", frames=frames))
        tracemalloc.start()
        for _ in read_blocks([video], block=16):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[0] < 4 * 16 * ROWS * COLUMNS * 3


def test_blocks_left_unread_stop_their_threads():
    blocks = read_blocks([open_video(MADE / "b_frames.mp4")] * 2, block=4, workers=2)
    next(blocks)
    before = threading.active_count()
    blocks.close()
    assert threading.active_count() < before


def test_a_film_held_upright_is_read_upright_and_says_so(tmp_path):
    data = (MADE / "b_frames.mp4").read_bytes()
    one = 1 << 16
    quarter = turned(data, [0, one, 0, -one, 0, 0, ROWS * one, 0, 1 << 30])
    (tmp_path / "portrait.mp4").write_bytes(quarter)
    video = open_video(tmp_path / "portrait.mp4")
    assert video.size == (COLUMNS, ROWS)
    assert re.search("turned by (90|270) degrees", video.notes[0])
    frame = read_frames(video, 21, 22)[0]
    assert number_of(np.rot90(frame, 1)) == 21


def test_frames_at_uneven_times_are_refused():
    with pytest.raises(InputError, match=r"constant rate: from frame 40 to 41 it takes 1.8"):
        open_video(MADE / "uneven.mkv")


def test_a_folder_is_read_by_number_and_gaps_are_said(tmp_path):
    for number in (9, 10, 11, 100):
        write_png(tmp_path / f"frame_{number}.png", numbered(number))
    (tmp_path / "notes.txt").write_text("not a frame")
    video = open_video(tmp_path)
    assert video.rate_hz is None
    assert [number_of(frame) for frame in read_frames(video, 0, 4)] == [9, 10, 11, 100]
    assert "88 numbers are missing" in video.notes[0]
    assert "the first is 12" in video.notes[0]
    (tmp_path / "frame_100.png").unlink()
    assert open_video(tmp_path).notes == ()


def test_folders_that_are_no_film_are_refused(tmp_path):
    with pytest.raises(InputError, match="holds no pictures; bring"):
        open_video(tmp_path)
    write_png(tmp_path / "1.png", numbered(1))
    write_png(tmp_path / "01.png", numbered(1))
    with pytest.raises(InputError, match=r"01.png and 1.png in .* have the same number"):
        open_video(tmp_path)
    (tmp_path / "01.png").rename(tmp_path / "cover.png")
    with pytest.raises(InputError, match=r"cover.png has no number"):
        open_video(tmp_path)
    (tmp_path / "cover.png").unlink()
    write_png(tmp_path / "2.png", numbered(2)[:16])
    with pytest.raises(InputError, match=r"frame 1 of .* is 48 x 16 where the first is 48 x 32"):
        read_frames(open_video(tmp_path), 0, 2)
    (tmp_path / "2.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"2.png is not a picture"):
        read_frames(open_video(tmp_path), 0, 2)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [("a.txt", b"x", "is not a film"), ("a.mp4", b"", "is empty"),
     ("a.mp4", b"no film at all", "cannot be opened as a film"),
     ("missing.mkv", None, "cannot be read")],
)  # fmt: skip
def test_what_is_no_film_is_refused_without_noise(tmp_path, capfd, name, content, said):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=said):
        open_video(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def read_or_refuse(path):
    """The numbers that the frames show, or None where the film was refused."""
    try:
        video = open_video(path)
        return [number_of(frame) for frame in read_frames(video, 0, video.frames)]
    except InputError as error:
        said = str(error)
    assert str(path.parent) in said
    assert "\n" not in said
    return None


@pytest.mark.parametrize("name", ["b_frames.mp4", "b_frames.mkv", "XVID.avi"])
def test_a_film_cut_anywhere_is_refused_or_whole_up_to_the_cut(tmp_path, capfd, name):
    data = film(tmp_path, name).read_bytes()
    path = tmp_path / f"cut{Path(name).suffix}"
    for size in range(1, len(data), len(data) // 25):
        path.write_bytes(data[:size])
        numbers = read_or_refuse(path)
        assert numbers is None or numbers == list(range(len(numbers)))
    assert capfd.readouterr() == ("", "")
    if path.suffix == ".avi":
        with pytest.raises(InputError, match="is cut off: it says that it is longer"):
            open_video(path)


def test_damaged_bytes_never_crash_and_make_no_noise(tmp_path, rng, capfd):
    for name in ("b_frames.mp4", "b_frames.mkv", "XVID.avi"):
        data = film(tmp_path, name).read_bytes()
        path = tmp_path / f"bad{Path(name).suffix}"
        for _ in range(20):
            spoiled = bytearray(data)
            for _ in range(rng.integers(1, 30)):
                spoiled[rng.integers(len(data))] = rng.integers(256)
            path.write_bytes(spoiled)
            read_or_refuse(path)
    assert capfd.readouterr() == ("", "")


def test_a_codec_that_is_not_known_is_refused(tmp_path, capfd):
    path = written(tmp_path / "film.avi", "XVID")
    path.write_bytes(path.read_bytes().replace(b"XVID", b"Q0Q0").replace(b"xvid", b"q0q0"))
    with pytest.raises(InputError, match="codec that is not known"):
        open_video(path)
    assert capfd.readouterr() == ("", "")


def test_a_film_that_shrank_after_it_was_opened_says_which_frame_is_lost(tmp_path):
    path = written(tmp_path / "film.avi", "MJPG")
    video = open_video(path)
    written(path, "MJPG", frames=40)
    with pytest.raises(InputError, match=r"frame 40 of the 60 of .* cannot be decoded"):
        read_frames(video, 30, 50)


def test_wrong_ranges_are_refused():
    video = open_video(MADE / "b_frames.mp4")
    for start, end in ((-1, 3), (5, 4), (0, 61)):
        with pytest.raises(ValueError, match=f"frames {start} to {end} are asked"):
            read_frames(video, start, end)
        with pytest.raises(ValueError, match=f"frames {start} to {end} are asked"):
            next(read_blocks([video], start=start, end=end))
    with pytest.raises(ValueError, match="one of each at least is wanted"):
        next(read_blocks([]))


def test_a_film_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    good = numbered(1)
    with pytest.raises(InputError, match=r"does not end in \.mp4"):
        write_video(tmp_path / "film.avi", [good], 30.0)
    with pytest.raises(ValueError, match="rate_hz is 0"):
        write_video(tmp_path / "film.mp4", [good], 0.0)
    with pytest.raises(ValueError, match="there is no frame"):
        write_video(tmp_path / "film.mp4", [], 30.0)
    for wrong in (good[:31], good.astype(float), good[:16], good[..., 0]):
        with pytest.raises(ValueError, match="no frame of this film"):
            write_video(tmp_path / "film.mp4", [good, wrong], 30.0)
    with pytest.raises(InputError, match="choose a folder that exists"):
        write_video(tmp_path / "nowhere" / "film.mp4", [good], 30.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.data
def test_a_recording_with_one_key_frame_is_read_to_the_frame(shared_data):
    video = open_video(shared_data / "captures" / "kimono" / "videos" / "cam1.mp4")
    assert (video.frames, video.size, len(video.keys)) == (150, (240, 320), 1)
    whole = read_frames(video, 0, 150)
    for start in (0, 1, 77, 149):
        np.testing.assert_array_equal(read_frames(video, start, start + 1)[0], whole[start])
