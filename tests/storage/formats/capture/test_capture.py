"""A capture is read when it is whole; each fault planted in one is named, all at once."""

import json
import re
import shutil

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.capture.capture import read_capture
from storage.formats.capture.capture_toml import Volume
from storage.formats.capture.initial import write_initial
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.video_writing import write_video
from storage.recordings import digest_capture
from tasks.studio.dancing.openings import stretch_arms_first
from tests.conftest import swaying_body
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, in_z_up, looking_at, rig
from tests.figures.films import moving, write_film

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


def in_cm(folder):
    files.write_pose2sim(folder, rig(), scale=100.0, metadata='unit = "m"\n')


def in_mm(folder):
    files.write_pose2sim(folder, rig(), scale=1000.0, metadata='unit = "m"\n')


def in_m_said_mm(folder):
    files.write_pose2sim(folder, rig(), metadata='unit = "mm"\n')


def one_away(folder):
    cameras = rig()
    cameras[1] = looking_at("2", (-1.0, 2.4, 3.1), (-1.0, 2.4, 9.0))
    files.write_pose2sim(folder, cameras, metadata='unit = "m"\n')


def z_up(folder):
    cameras = rig()
    for camera in cameras:
        rotation, translation = in_z_up(camera)
        object.__setattr__(camera, "rotation", rotation)
        object.__setattr__(camera, "translation", translation)
    files.write_pose2sim(folder, cameras, metadata='unit = "m"\n')


def volume_z_up(folder):
    edit(folder, "[0.1, 1.0, -0.2]", "[0.1, 3.2, 1.0]")
    for_volume = [looking_at(c.name, c.center_m - [0, 0, 3], (0.1, 1.0, -3.2)) for c in rig()]
    files.write_pose2sim(folder, for_volume, metadata='unit = "m"\n')


def remove(name):
    def spoil(folder):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    return spoil


def cut_short(folder):
    path = folder / "videos" / "2.mp4"
    path.write_bytes(path.read_bytes()[:700])


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


FAULTS = {
    "no video": (remove("videos/2.mp4"), "camera '2' has no video in `videos`: name each file"),
    "no background": (
        remove("background/side.png"), "camera 'side' has no background in `background`",
    ),
    "no videos": (remove("videos"), "there is no folder `videos` with a video a camera"),
    "no calibration": (remove("calibration.toml"), "there is no calibration: put it there as"),
    "two calibrations": (
        lambda folder: files.write_panoptic(folder, rig()),
        "more than one calibration: 'calibration.json', 'calibration.toml'; keep one",
    ),
    "bad calibration": (
        lambda folder: edit(folder, "translation", "where", "calibration.toml"),
        "camera '01': it has no translation",
    ),
    "named otherwise": (
        lambda folder: (folder / "videos/01.mp4").rename(folder / "videos/1.mp4"),
        "camera '01' has no video in `videos`; '1' belongs to no camera of the calibration",
    ),
    "two videos": (
        lambda folder: shutil.copy(folder / "videos/2.mp4", folder / "videos/2.mov"),
        "camera '2' has more than one video: '2.mov', '2.mp4'; keep one",
    ),
    "empty video": (
        lambda folder: (folder / "videos/2.mp4").write_bytes(b""), "2.mp4 is empty",
    ),
    "cut video": (cut_short, "camera '2': "),
    "no video at all": (
        lambda folder: (folder / "videos/2.mp4").write_text("hello" * 99), "camera '2': ",
    ),
    "bad background": (
        lambda folder: (folder / "background/2.png").write_bytes(b"\x89PNG no"),
        "2.png cannot be decoded: it is damaged or no picture",
    ),
    "turned": (
        lambda folder: film(folder / "videos/2.mp4", size=(480, 640)),
        "camera '2': its video is 480x640, its calibration was made for 640x480: the video is "
        "turned (portrait); turn it back",
    ),
    "scaled": (
        lambda folder: film(folder / "videos/2.mp4", size=(320, 240)),
        "its video is 320x240, its calibration was made for 640x480: the video is scaled by 0.5",
    ),
    "cropped": (
        lambda folder: film(folder / "videos/2.mp4", size=(600, 480)),
        "its video is 600x480, its calibration was made for 640x480: of another shape",
    ),
    "background scaled": (
        lambda folder: write_png(folder / "background/2.png", np.zeros((240, 320, 3), np.uint8)),
        "camera '2': its background is 320x240, its video 640x480; film the background",
    ),
    "no masks of a camera": (
        with_masks(remove("silhouettes/2.mp4")), "camera '2' has no mask in `silhouettes`: name",
    ),
    "masks of no kind": (
        with_masks(
            lambda folder: (folder / "silhouettes/2.mp4").rename(folder / "silhouettes/2.gif")
        ),
        "'2.gif' is of no kind that is read (.mp4",
    ),
    "masks of another size": (
        with_masks(lambda folder: film(folder / "silhouettes/2.mp4", size=(320, 240))),
        "camera '2': its masks are 320x240, its video 640x480; make them of the frames as they",
    ),
    "masks of another count": (
        with_masks(lambda folder: film(folder / "silhouettes/2.mp4", frames=FRAMES - 1)),
        "camera '2' has 11 masks for the 12 frames of its video; bring one for each frame",
    ),
    "a mask is missing": (
        with_masks(gap_in_masks), "camera '2' has 11 masks (1 numbers are missing among the pict",
    ),
    "masks that are no film": (
        with_masks(lambda folder: (folder / "silhouettes/2.mp4").write_bytes(b"no film" * 99)),
        "2.mp4 cannot be ",
    ),
    "a mask that is no picture": (
        with_masks(
            lambda folder: gap_in_masks(folder)
            or (folder / "silhouettes/2/0.png").write_bytes(b"\x89PNG no")
        ),
        "0.png is not a picture that can be read",
    ),
    "too short": (
        lambda folder: film(folder / "videos/2.mp4", frames=8),
        "unequal length: '2' 8, the others 12 frames; at most 3 (0.1 s) may be missing",
    ),
    "other rate": (
        lambda folder: film(folder / "videos/2.mp4", rate_hz=25.0),
        "not filmed at one rate: '2' at 25, the others at 30 frames a second",
    ),
    "in cm": (in_cm, 'volume of 2.83 m; if the calibration is in cm, write unit = "cm" under'),
    "in mm": (in_mm, 'too far to see a volume of 2.83 m; if the calibration is in mm, write unit'),
    "said mm": (in_m_said_mm, 'which is inside a volume of 2.83 m; if the calibration is in m, w'),
    "looks away": (one_away, "camera '2' does not see the volume around [0.1, 1.0, -0.2]; corr"),
    "volume z up": (volume_z_up, "[volume] is written with y up: center_m = [0.1, 1.0, -3.2]"),
    "no center": (
        lambda folder: edit(folder, "center_m", "centre"), "center_m = None under [volume]",
    ),
    "flat": (
        lambda folder: edit(folder, "2.0, 1.2", "0.0, 1.2"), "size_m = [1.6, 0.0, 1.2] under",
    ),
    "voxel": (lambda folder: edit(folder, "0.02", "20"), "voxel_m = 20 under [volume] should be"),
    "voxels": (
        lambda folder: edit(folder, "0.02", "0.0005"), "far too many voxels of 0.0005 m; change vo",
    ),
    "fps": (lambda folder: edit(folder, "30.0", "true"), "fps = True under [video] should be"),
    "up": (lambda folder: edit(folder, '"y"', '"north"'), "up = 'north' under [video] is no axis"),
    "unit": (
        lambda folder: edit(folder, "fps", 'unit = "ell"\nfps'), "unit = 'ell' under [video] is",
    ),
    "stature": (lambda folder: edit(folder, "1.58", "158"), "stature_m = 158 under [take] is no"),
    "initial": (
        lambda folder: (folder / "initial.json").write_text('{"joints": {"Head": [0, 1]}}'),
        "initial.json cannot be used: 'Head' must be three finite numbers [x, y, z] in metres; ",
    ),
    "initial frame": (initial_of(FRAMES), "initial.json is of frame 12; the take has the frames 0"),
    "id": (lambda folder: edit(folder, "[take]", '[take]\nid = "!"'), "makes no name for a take"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_no_other(folder, fault):
    spoil, message = FAULTS[fault]
    spoil(folder)
    (line,) = faults(folder)
    assert message in line


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


def test_all_faults_are_named_at_once_a_line_each(folder):
    kinds = ["no background", "scaled", "voxel", "stature"]
    for kind in kinds:
        FAULTS[kind][0](folder)
    lines = faults(folder)
    assert len(lines) == len(kinds)
    for kind in kinds:
        assert sum(FAULTS[kind][1] in line for line in lines) == 1


def test_a_world_on_its_side_is_said(folder):
    z_up(folder)
    try:
        said = " ".join(read_capture(folder).notes)
    except InputError as error:
        said = str(error)
    assert "stand upright along z, though y is said to point up" in said or "`up`" in said


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


def test_no_rate_at_all_is_a_fault(folder):
    edit(folder, "fps = 30.0", "")
    for name in NAMES:
        (folder / "videos" / f"{name}.mp4").unlink()
        (folder / "videos" / name).mkdir()
        write_png(folder / "videos" / name / "0.png", np.zeros((480, 640, 3), np.uint8))
    assert faults(folder) == [
        "capture.toml has no fps under [video], and the videos do not say it; write it"
    ]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (remove("capture.toml"), "has no capture.toml, so it is no capture"),
        (lambda folder: edit(folder, "[take]", "[take"), "capture.toml is not TOML"),
        (lambda folder: (folder / "capture.toml").write_text("volume = 3"),
         "has 'volume' as a value, not as a table"),
        (lambda folder: (folder / "capture.toml").write_text(""), "is empty; bring a capture.toml"),
        (shutil.rmtree, "is no folder; bring one with a capture.toml"),
    ],
)  # fmt: skip
def test_a_folder_without_a_readable_capture_toml_is_no_capture(folder, spoil, message):
    spoil(folder)
    with pytest.raises(InputError, match=message):
        read_capture(folder)


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


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("offset_s = { cam1 = nan }", "offset_s of camera 'cam1' in capture.toml is nan"),
        ("offset_s = { cam9 = 0.1 }", "capture.toml has an offset_s of 'cam9', of which there is"),
        ("offset_s = 0.1", "offset_s = 0.1 under [video] of capture.toml is no table"),
        ("offset_s = { cam1 = 0.4 }", "camera 'cam1' began 0.4 s later than camera"),
        ("offset_s = { cam1 = -1 }", "began 1 s later than camera 'cam1', whose film had ended"),
    ],
)
def test_offsets_that_cannot_be_are_named(folder, line, fault):
    edit(folder, "fps = 30.0", f"fps = 30.0\n{line.replace('cam1', NAMES[0])}")
    [said] = faults(folder)
    assert fault.replace("cam1", NAMES[0]) in said


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
