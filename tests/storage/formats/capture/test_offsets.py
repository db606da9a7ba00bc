"""When films began: what capture.toml says, and which frames are then those of the take."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.formats.capture.clocks import clock_notes, timecode_s
from storage.formats.capture.footage import Footage
from storage.formats.capture.offsets import Alignment, align_films, offset_line, read_offsets
from storage.formats.pictures.video import open_video, read_blocks
from storage.formats.toml_text import parse_toml
from tests.figures.films import moving, write_film

NAMES = ("cam1", "cam2", "cam3")


def read(text, known=NAMES):
    """What is read of a line under [video], and the faults."""
    faults = []
    found = read_offsets(parse_toml(Path("capture.toml"), text, ""), known, "capture.toml", faults)
    return found, faults


def align(counts, offsets_s, fps=30.0):
    faults, notes = [], []
    counts = dict(zip(NAMES, counts, strict=True))
    return align_films(counts, offsets_s, fps, faults, notes), faults, notes


def test_seconds_of_some_cameras_are_read_and_written_as_they_are_read():
    assert read("fps = 30.0") == (None, [])
    found, faults = read("offset_s = { cam3 = 0.1, cam1 = -2 }")
    assert (found, faults) == ({"cam3": 0.1, "cam1": -2.0}, [])
    strange = {'stage "left"': 0.25, "後ろ": -0.1, "cam-3": 0.0}
    assert read(offset_line(strange), tuple(strange))[0] == strange


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("offset_s = 0.1", "offset_s = 0.1 under [video] of capture.toml is no table"),
        ("offset_s = { cam3 = nan }", "offset_s of camera 'cam3' in capture.toml is nan"),
        ("offset_s = { cam3 = inf }", "should be seconds, such as 0.1"),
        ('offset_s = { cam3 = "0.1" }', "is '0.1', and should be seconds"),
        ("offset_s = { cam3 = true }", "is True, and should be seconds"),
        ("offset_s = { cam7 = 0.1 }", "offset_s of 'cam7', of which there is no film: there are"),
    ],
)
def test_what_is_no_offset_is_said(text, said):
    _, faults = read(text)
    assert len(faults) == 1
    assert said in faults[0]


def test_a_camera_is_known_however_its_name_is_composed():
    assert read('offset_s = { "カ\u3099" = 1 }', ("ガ",)) == ({"ガ": 1.0}, [])


def test_a_film_that_began_late_begins_the_take():
    aligned, faults, notes = align((150, 150, 147), {"cam3": 0.1})
    assert aligned == Alignment((3, 3, 0), 147)
    assert (faults, notes) == (
        [], ["By offset_s the take begins with frame 0 of 'cam3'; frame 3 of 'cam1', 'cam2'."],
    )  # fmt: skip
    early, _, notes = align((150, 150, 150), {"cam3": -0.1})
    assert early == Alignment((0, 0, 3), 147)
    assert notes[-1] == (
        "Frames at the end that not all cameras filmed are left out: 3 of 'cam1', 3 of 'cam2'."
    )


def test_of_moments_between_frames_the_nearest_are_used_and_how_near_is_said():
    aligned, _, notes = align((150, 150, 150), {"cam3": 0.08})
    assert aligned.first_frames == (2, 2, 0)
    assert (
        "nearest frame is used: 'cam3' 0.0133 s later than the moment of the take (0.40"
        in (notes[0])
    )
    # all by the same part of a frame are none of them off
    aligned, _, notes = align((150, 150, 150), {"cam1": 0.51, "cam2": 0.51, "cam3": 0.61})
    assert aligned.first_frames == (3, 3, 0)
    assert "nearest" not in notes[0]


@given(
    late=st.lists(st.floats(-20, 20), min_size=2, max_size=6),
    fps=st.sampled_from([10.0, 29.97, 59.94]),
)
@pytest.mark.filterwarnings("error")
def test_no_film_is_ever_more_than_half_a_frame_beside_its_moment(late, fps):
    names = [f"c{n}" for n in range(len(late))]
    offsets_s = {name: frames / fps for name, frames in zip(names, late, strict=True)}
    aligned = align_films(dict.fromkeys(names, 200), offsets_s, fps, [], [])
    first = np.array(aligned.first_frames)
    assert first.min() == 0
    assert aligned.frames == 200 - first.max()
    moments = first + np.array(late)  # of frame 0 of the take, in frames
    assert np.ptp(moments) <= 1.0 + 1e-5


@pytest.mark.parametrize(
    ("offsets_s", "said"),
    [
        ({"cam3": 5.0}, "'cam3' began 5 s later than camera 'cam1', whose film had ended after 5 "),
        ({"cam3": -5.0}, "'cam1' began 5 s later than camera 'cam3', whose film had ended after"),
        ({"cam1": 3.0, "cam2": -3.0}, "'cam1' began 6 s later than camera 'cam2'"),
        ({"cam2": 1e9}, "'cam2' began 1e+09 s later than camera 'cam1'"),
    ],
)
def test_films_without_a_common_moment_are_refused(offsets_s, said):
    aligned, [fault], _ = align((150, 150, 150), offsets_s)
    assert aligned.frames == 0
    assert said in fault
    assert fault.endswith("correct offset_s, or leave a camera out")


def test_unequal_lengths_are_told_until_somebody_says_when_films_began():
    aligned, faults, notes = align((150, 150, 100), None)
    assert aligned.unequal.startswith("the videos are of unequal length: 'cam3' 100, the others")
    assert "say by offset_s under [video] when each began" in aligned.unequal
    assert (faults, notes) == ([], [])  # who reads the capture decides
    aligned, faults, notes = align((150, 150, 100), {"cam1": 0.0})
    assert aligned == Alignment((0, 0, 0), 100)
    assert (faults, len(notes)) == ([], 2)


def test_films_are_read_from_the_frames_that_count_as_first(tmp_path):
    frames = moving(12, rows=32, columns=48)
    films = [
        open_video(write_film(tmp_path / f"{n}.mkv", frames[n:], "ffv1", pixels="bgr0"))
        for n in (0, 3)
    ]
    read = [block for _, block in read_blocks(films, block=4, firsts=(3, 0))]
    for one, other in read:
        np.testing.assert_array_equal(one, other)
    assert sum(len(one) for one, _ in read) == 9
    with pytest.raises(ValueError, match="frames 0 to 10 are asked of films of which the shortest"):
        next(read_blocks(films, end=10, firsts=(3, 0)))


def footage(name, *, frames=150, timecode="", created=""):
    return Footage(Path(name), (64, 48), frames, 30.0, timecode=timecode, created=created)


def notes_of(**told):
    return clock_notes(
        {name: footage(name, **each) for name, each in zip(NAMES, told["each"], strict=True)},
        told.get("fps", 30.0),
    )


@pytest.mark.parametrize(
    ("timecode", "fps", "seconds"),
    [
        ("01:02:03:15", 30.0, 3723.5),
        ("00:01:00;02", 30000 / 1001, 60.06),  # the first number after 00:00:59;29
        ("10:00:00;00", 30000 / 1001, 35999.964),
        ("24:00:00:00", 30.0, None),
        ("00:00:00:30", 30.0, None),
        ("noon", 30.0, None),
    ],
)
def test_a_timecode_is_seconds_since_midnight(timecode, fps, seconds):
    assert timecode_s(timecode, fps) == (seconds and pytest.approx(seconds, abs=1e-3))


def test_timecodes_are_told_as_hints_also_around_midnight():
    each = [{"timecode": code} for code in ("23:59:59:20", "23:59:59:20", "00:00:00:05")]
    [note] = notes_of(each=each)
    assert "began later than the first: 'cam3' by 0.500 s (15 frames). That is a hint" in note
    [note] = notes_of(each=[{"timecode": "10:00:00:00"}] * 3)
    assert note == "The timecodes of all films say that they began together."
    assert notes_of(each=[{"timecode": "10:00:00:00"}] * 2 + [{}]) == []
    assert notes_of(each=[{"timecode": "10:00:00:00"}] * 3, fps=0.0) == []


def test_a_film_longer_than_the_clock_of_a_day_is_told():
    each = [{"timecode": "10:00:00:00", "frames": 100}] * 2
    [note] = notes_of(each=[*each, {"timecode": "09:00:00:00", "frames": 864_030}], fps=10.0)
    assert note.startswith("The film of camera 'cam3' is longer than a day, so that its timecode")


def test_times_of_creation_are_told_where_they_differ():
    each = [{"created": f"2026-03-02T10:00:{n:02d}.000000Z"} for n in (0, 1, 7)]
    [note] = notes_of(each=each)
    assert "created later than the first: 'cam2' by 1 s, 'cam3' by 7 s. That is a weak hint" in note
    assert notes_of(each=[{"created": "yesterday"}] * 3) == []
    assert notes_of(each=[{"created": "2026-03-02T10:00:00Z"}] * 3) == []


def test_clocks_are_read_from_files(tmp_path):
    said = {"timecode": "01:00:00:00", "creation_time": "2026-03-02T10:00:00.000000Z"}
    for name in ("a.mkv", "a.mov"):
        video = open_video(
            write_film(tmp_path / name, moving(3, rows=32, columns=48), metadata=said)
        )
        assert video.created.startswith("2026-03-02T10:00:00")
        assert video.timecode == ("01:00:00:00" if name == "a.mkv" else video.timecode)


@given(st.text(max_size=40))
def test_any_text_is_a_timecode_or_none(text):
    seconds = timecode_s(text, 25.0)
    assert seconds is None or 0 <= seconds <= 86_400
