"""Each fault planted in a capture is named, and no other; several are named all at once."""

import shutil

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.pictures import write_png
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, in_z_up, looking_at, rig
from tests.storage.formats.capture.conftest import (
    FRAMES,
    edit,
    faults,
    film,
    gap_in_masks,
    initial_of,
    remove,
    with_masks,
)


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


def cut_short(folder):
    path = folder / "videos" / "2.mp4"
    path.write_bytes(path.read_bytes()[:700])


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
