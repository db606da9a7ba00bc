"""Films of a capture as cameras write them: kinds, pixels, dates of frames, late beginnings."""

import re
import shutil

import pytest

from storage.formats.capture.capture import read_capture
from tests.figures.calibration_files import NAMES
from tests.figures.films import moving, write_film
from tests.storage.formats.capture.conftest import FRAMES, edit, faults, film


def test_films_of_camcorders_are_read_and_their_notes_said_once(folder):
    for name in NAMES:
        path = folder / "videos" / f"{name}.mp4"
        path.unlink()
        write_film(
            path.with_suffix(".mts"), moving(FRAMES, rows=480, columns=640), "libx264",
            options={"flags": "+ilme+ildct", "x264-params": "tff=1"}, aspect="4/3",
        )  # fmt: skip
    capture = read_capture(folder)
    assert [path.suffix for path in capture.videos] == [".mts"] * len(NAMES)
    for said in ("Pixels are 1.333 times as wide", "The film says that it is interlaced, but"):
        assert [said in note for note in capture.notes].count(True) == 1
        note = next(note for note in capture.notes if said in note)
        assert sorted(re.findall("'(.+?)'", note.split(":")[0])) == sorted(NAMES)


def test_films_and_backgrounds_that_do_not_date_their_frames_are_said_in_one_note(folder):
    for name in NAMES:
        (folder / "videos" / f"{name}.mp4").unlink()
        (folder / "background" / f"{name}.png").unlink()
        frames = moving(FRAMES, rows=480, columns=640)
        write_film(folder / "videos" / f"{name}.avi", frames, "libx264", options={"bf": "3"})
        shutil.copy(folder / "videos" / f"{name}.avi", folder / "background")
    notes = [note for note in read_capture(folder).notes if "when each frame is shown" in note]
    assert len(notes) == 1
    assert notes[0].startswith("The videos of ")
    assert " and the backgrounds of " in notes[0]


def test_files_of_kinds_that_are_not_read_are_named_with_those_that_are(folder):
    for name in NAMES:
        path = folder / "videos" / f"{name}.mp4"
        path.rename(path.with_suffix(".braw"))
    (said,) = [fault for fault in faults(folder) if "has no video" in fault]
    assert "'2.braw'" in said
    assert re.search(r"is of no kind that is read \(\.mp4, \.m4v, .*\.mts.*\)", said)


@pytest.mark.parametrize(
    ("size", "aspect", "said"),
    [((480, 480), "4/3", "are not square, so that players show 640x480; calibrate with pictures"),
     ((320, 480), "4/3", "players show 427x480, or one of them was cut; calibrate with")],
)  # fmt: skip
def test_a_film_whose_pixels_are_not_square_is_not_said_to_be_cut(folder, size, aspect, said):
    frames = moving(FRAMES, rows=size[1], columns=size[0])
    path = folder / "videos" / "2.mp4"
    write_film(path, frames, "libx264", aspect=aspect)
    (fault,) = [fault for fault in faults(folder) if "camera '2': its video is" in fault]
    assert said in fault
    assert "of another shape" not in fault


def test_a_background_grabbed_from_a_player_is_said(folder):
    frames = moving(FRAMES, rows=480, columns=480)
    write_film(folder / "videos" / "2.mp4", frames, "libx264", aspect="4/3")
    text = (folder / "calibration.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("size")]
    (folder / "calibration.toml").write_text("\n".join(lines))
    assert any("bring the background as a film of its own" in fault for fault in faults(folder))


def test_a_film_that_began_late_begins_the_take(folder):
    film(folder / "videos" / f"{NAMES[0]}.mp4", frames=FRAMES - 5)
    [said] = faults(folder)
    assert "say by offset_s under [video] when each began, which `shosa doctor` estimates" in said
    assert read_capture(folder, any_length=True).unequal == said
    edit(folder, "fps = 30.0", f"fps = 30.0\noffset_s = {{ {NAMES[0]} = {5 / 30:.4f} }}")
    capture = read_capture(folder)
    assert capture.first_frames == (0, 5, 5)
    assert capture.frames == FRAMES - 5
    assert capture.offsets_s == (pytest.approx(5 / 30, abs=1e-4), 0.0, 0.0)
    assert capture.unequal == ""
