import csv
import dataclasses
import shutil

import cv2
import numpy as np
import pytest

from flows.command.main import BAD_INPUT, DONE, WRONG_USE, main
from storage import create_archive, open_archive
from storage.arrays.cameras import write_cameras
from storage.arrays.poses import write_body, write_pose
from storage.arrays.voxels import write_voxels
from storage.formats.calibration.camera import Camera
from storage.formats.capture.initial import read_initial
from storage.formats.pictures.video import open_video, read_frames
from storage.provenance import Provenance
from storage.publication import describe_files, publish_record, version_folder
from storage.records import Record
from tasks.geometry.voxels import encode_runs, surface_voxels
from tests.conftest import swaying_body

FRAMES, SHAPE, VOXEL_M = 3, (12, 20, 9), 0.1
LABELS = (1, 5)  # Head, RForeArm


def figure(frame):
    """Return (x, y, z) bool: a red box that moves along x, with a blue one on top of it."""
    occupied = np.zeros(SHAPE, np.bool_)
    if frame < FRAMES - 1:
        occupied[2 + frame : 6 + frame, 2:17, 2:7] = True
    return occupied


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """An archive with a take of two frames of voxels and an empty one."""
    location = tmp_path_factory.mktemp("view") / "archive"
    place = create_archive(location).place
    folder = version_folder("okuri", "000001-a")
    about = Provenance("carving", {}, {})
    focal = np.array([[200.0, 0.0, 59.5], [0.0, 200.0, 39.5], [0.0, 0.0, 1.0]])
    level = np.diag([1.0, -1.0, -1.0])  # looks along -Z
    camera = Camera("cam1", (120, 80), focal, np.zeros(0), level, -level @ [0.6, 1.0, 6.0])
    write_cameras(place, folder, [camera], about)
    occupied = np.stack([figure(frame) for frame in range(FRAMES)])
    runs = encode_runs(occupied)
    surface = [surface_voxels(runs, frame) for frame in range(FRAMES)]
    height = [np.argwhere(each)[:, 1] for each in occupied]
    rgb = [np.where(h[:, None] > 12, [30, 40, 220], [220, 40, 30]) for h in height]
    counts = np.cumsum([0, *map(len, surface)])
    label = np.concatenate([np.where(h > 12, *LABELS) for h in height]).astype(np.uint8)
    write_voxels(
        place, folder,
        {
            "run": runs.offset,
            "voxel": counts,
            "surface": np.cumsum([0, *(int(each.sum()) for each in surface)]),
        },
        {
            "run_start": [runs.start], "run_length": [runs.length],
            "is_surface": surface, "label": [label], "provisional_label": [label],
            "color": [c[s].astype(np.uint8) for c, s in zip(rgb, surface, strict=True)],
            "camera": [np.zeros(int(s.sum()), np.uint8) for s in surface],
        },
        attributes={
            "origin_m": [0.05, 0.05, 0.05], "voxel_m": VOXEL_M, "shape": list(SHAPE),
            "provenance": about.attributes(),
        },
        array_attributes={}, rate_hz=10.0,
    )  # fmt: skip
    place_m = np.zeros((FRAMES, 11, 3))
    place_m[:, 4, 0] = [0.0, 0.1, 0.3]
    turn = np.broadcast_to(np.eye(3), (FRAMES, 11, 3, 3))
    pose = {
        "position": place_m, "rotation": turn, "local_position": place_m, "local_rotation": turn,
        "quality": np.ones((FRAMES, 11)), "doubtful": np.zeros(FRAMES, np.bool_),
    }  # fmt: skip
    write_pose(place, folder, pose, rate_hz=10.0, attributes={}, provenance=about)
    publish_record(
        place,
        Record(
            "okuri", "000001-a", 1, {"kind": "capture", "name": "c", "path": "c", "digest": "0"},
            {}, FRAMES, 10.0, [], ["cameras", "voxels", "labels", "pose"],
            describe_files(place, "okuri", "000001-a"),
        ),
    )  # fmt: skip
    return str(location)


def picture_of(path):
    return cv2.imread(str(path))[..., ::-1].astype(int)


def is_red(image):
    return (image[..., 0] - image[..., 2] > 60).any(axis=1)


def is_blue(image):
    return (image[..., 2] - image[..., 0] > 60).any(axis=1)


def test_a_still_shows_the_colors_where_they_are(made, tmp_path):
    file = tmp_path / "a.png"
    assert main(["render", made, "okuri", str(file), "--frame", "0", "--size", "160x120"]) == DONE
    image = picture_of(file)
    assert image.shape == (120, 160, 3)
    red, blue = np.flatnonzero(is_red(image)), np.flatnonzero(is_blue(image))
    assert len(red) > 40
    assert blue.max() <= red.min() + 2  # the blue box is on top
    assert blue.min() > 5  # all of it is in the picture


def test_segments_are_told_apart_by_color(made, tmp_path):
    file = tmp_path / "a.png"
    options = ["--frame", "0", "--size", "160x120", "--color", "segments"]
    assert main(["render", made, "okuri", str(file), *options]) == DONE
    image = picture_of(file)
    red, green, blue = np.moveaxis(image.astype(int), 2, 0)
    orange = ((green - blue) > 60).any(axis=1)  # the head
    pink = ((red - green > 40) & (abs(green - blue) < 20)).any(axis=1)  # the right forearm
    assert orange.sum() > 10
    assert pink.sum() > 20
    assert np.flatnonzero(orange).max() <= np.flatnonzero(pink).min() + 2


def test_the_view_of_a_camera_shows_what_it_filmed(made, tmp_path):
    file = tmp_path / "a.png"
    options = ["--frame", "1", "--size", "120x80", "--camera", "cam1"]
    assert main(["render", made, "okuri", str(file), *options]) == DONE
    image = picture_of(file)
    drawn = np.abs(image[..., 0] - image[..., 2]) > 60
    rows, columns = np.nonzero(drawn)
    # the box in frame 1: x 0.3 to 0.7 m, y 0.2 to 1.7 m, its front 5.3 m before the camera
    for found, wanted in (
        (columns.min(), 59.5 + 200 * (0.3 - 0.6) / 5.3),
        (columns.max(), 59.5 + 200 * (0.7 - 0.6) / 5.3),
        (rows.min(), 39.5 - 200 * (1.7 - 1.0) / 5.3),
        (rows.max(), 39.5 - 200 * (0.2 - 1.0) / 5.3),
    ):
        assert abs(found - wanted) < 2.5


def test_a_film_has_every_frame_and_an_empty_one_shows_the_floor(made, tmp_path):
    file = tmp_path / "a.mp4"
    assert main(["render", made, "okuri", str(file), "--size", "160x120", "--orbit", "0.5"]) == DONE
    video = open_video(file)
    assert video.frames == FRAMES
    assert video.rate_hz == pytest.approx(10.0)
    frames = read_frames(video, 0, FRAMES).astype(int)
    assert is_red(frames[0]).any()
    assert is_red(frames[1]).any()
    assert not is_red(frames[2]).any()


def ply(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    return head.decode(), body


def test_points_have_color_and_label(made, tmp_path):
    file = tmp_path / "a.ply"
    assert main(["export", made, "okuri", str(file), "--frames", "1-1"]) == DONE
    head, body = ply(file)
    count = int(surface_voxels(encode_runs(figure(1)[None]), 0).sum())
    assert f"element vertex {count}\n" in head
    point = np.dtype([("x", "<f4", 3), ("rgb", "u1", 3), ("label", "u1")])
    points = np.frombuffer(body, point)
    high = points["x"][:, 1] > 1.3
    assert set(points["label"][high]) == {LABELS[0]}
    assert set(points["label"][~high]) == {LABELS[1]}
    np.testing.assert_array_equal(np.unique(points["rgb"][high], axis=0), [[30, 40, 220]])
    assert points["x"].min(axis=0) == pytest.approx([0.35, 0.25, 0.25])


def test_one_segment_is_exported_on_its_own(made, tmp_path):
    file = tmp_path / "a.ply"
    options = ["--frames", "0-0", "--segment", "Head"]
    assert main(["export", made, "okuri", str(file), *options]) == DONE
    assert f"element vertex {4 * 4 * 5}\n" in ply(file)[0]
    assert main(["export", made, "okuri", str(file), *options, "--mesh"]) == DONE
    assert "element face" in ply(file)[0]


def test_a_segments_motion_is_a_table(made, tmp_path):
    file = tmp_path / "a.csv"
    assert main(["export", made, "okuri", str(file), "--segment", "RForeArm"]) == DONE
    rows = list(csv.DictReader(file.read_text().splitlines()))
    assert [float(row["x_m"]) for row in rows] == [0.0, 0.1, 0.3]
    assert [float(row["vx_m_s"]) for row in rows] == pytest.approx([1.0, 1.5, 2.0])
    assert [float(row["qw"]) for row in rows] == [1.0] * 3


def test_what_the_body_was_measured_by_is_exported_with_a_picture(made, tmp_path):
    copy = shutil.copytree(made, tmp_path / "archive")
    opened = open_archive(copy)
    position = swaying_body(1, 1)[0] * [0.6, 1.0, 1.0] + [0.6, 0.2, 0.4]
    folder = opened.take("okuri").folder
    segment = {name: np.zeros((11, 3)) for name in ("centroid", "variance", "offset")}
    body = {
        **segment, "axes": np.zeros((11, 3, 3)), "joint_offset": np.zeros((21, 3)),
        "volume_share": np.zeros(11), "initial_joint": position,
    }  # fmt: skip
    about = Provenance("pose", {}, {})
    write_body(
        opened.place, folder, body,
        attributes={"initial_frame": 1, "confidence": 0.83}, provenance=about,
    )  # fmt: skip
    record = opened.take("okuri").record
    files = describe_files(opened.place, "okuri", record.version)
    again = dataclasses.replace(record, number=2, stages=[*record.stages, "body"], files=files)
    publish_record(opened.place, again)
    file = tmp_path / "out" / "initial.json"
    file.parent.mkdir()
    assert main(["export", str(copy), "okuri", str(file)]) == DONE
    found = read_initial(file)
    assert found.frame == 1
    np.testing.assert_allclose(found.position, position, atol=1e-4)
    image = picture_of(file.with_suffix(".png"))
    assert image.shape == (480, 960, 3)
    assert (image.min(axis=2) < 200).mean() > 0.02
    assert len(list(file.parent.iterdir())) == 2


def test_damaged_voxels_are_neither_drawn_nor_written(made, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(made, copy)
    folder = copy / version_folder("okuri", "000001-a") / "voxels"
    for array, harm in (("run_start", bytes), ("color", None), ("is_surface", bytes)):
        [shard] = [path for path in (folder / array / "c").rglob("*") if path.is_file()]
        whole = shard.read_bytes()
        shard.unlink() if harm is None else shard.write_bytes(harm(len(whole)))
        for command in (["render", "a.png"], ["render", "a.mp4"], ["export", "a.ply"]):
            file = tmp_path / command[1]
            assert main([command[0], str(copy), "okuri", str(file)]) == BAD_INPUT
            err = capsys.readouterr().err
            assert "take 'okuri' is damaged" in err
            assert err.count("\n") == 1
            assert not file.exists()
        shard.write_bytes(whole)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["render", "A", "okuri", "a.jpg"], BAD_INPUT, "should end in .png"),
        (["render", "A", "okuri", "a.png", "--frame", "9"], BAD_INPUT, "frames 0-2; 9-9 goes"),
        (["render", "A", "okuri", "a.png", "--size", "9"], WRONG_USE, "should be WxH"),
        (["render", "A", "okuri", "a.mp4", "--size", "33x44"], BAD_INPUT, "even number"),
        (
            ["render", "A", "okuri", "a.png", "--camera", "x"],
            WRONG_USE,
            "no camera 'x'; it has cam1",
        ),
        (["render", "A", "okuri", "a.png", "--azimuth", "nan"], WRONG_USE, "should be numbers"),
        (["render", "A", "okuri", "a.png", "--frame", "-1"], WRONG_USE, "should be 0 or more"),
        (["render", "A", "okurl", "a.png"], WRONG_USE, "did you mean okuri?"),
        (["render", "A", "okuri", "a.png", "--orbit", "1"], WRONG_USE, "--orbit is of a film"),
        (["render", "A", "okuri", "a.mp4", "--frame", "1"], WRONG_USE, "--frame is of a still"),
        (
            ["render", "A", "okuri", "a.png", "--frame", "1", "--frames", "0-1"],
            WRONG_USE,
            "leave out one of them",
        ),
        (
            ["render", "A", "okuri", "a.png", "--camera", "cam1", "--azimuth", "3"],
            WRONG_USE,
            "leave out --azimuth",
        ),
        (["render", "A", "okuri", "a.png", "--frame", "9" * 99], WRONG_USE, "and 1,000,000,000 at"),
        (["render", "A", "okuri", "a.mp4", "--orbit", "1e308"], WRONG_USE, "should be numbers, up"),
        (
            ["render", "A", "okuri", "a.png", "--size", "9" * 5000 + "x9"],
            WRONG_USE,
            "should be WxH",
        ),
        (
            ["render", "A", "okuri", "none/a.png", "--size", "32x24"],
            BAD_INPUT,
            "cannot be written",
        ),
        (["export", "A", "okuri", "a.ply", "--frames", "0-1"], WRONG_USE, "holds one frame"),
        (["export", "A", "okuri", "a.ply", "--frames", "2-2"], BAD_INPUT, "no voxel is occupied"),
        (["export", "A", "okuri", "a.ply", "--frames", "7-7"], BAD_INPUT, "7 goes beyond"),
        (["export", "A", "okuri", "a.ply", "--segment", "Arm"], WRONG_USE, "no segment 'Arm'"),
        (["export", "A", "okuri", "a.bvh", "--segment", "Head"], WRONG_USE, "written as .ply"),
        (["export", "A", "okuri", "a.csv", "--mesh"], WRONG_USE, "--mesh is for PLY"),
        (["export", "A", "okuri", "a.json"], BAD_INPUT, "has no initial model: its pose was not"),
        (["export", "A", "okuri", "a.json", "--frames", "1-1"], WRONG_USE, "leave out --frames"),
        (["export", "A", "okuri", "a.trc"], BAD_INPUT, "'okuri' has no motion"),
    ],
)
def test_mistakes_are_said_in_a_sentence(
    made, tmp_path, monkeypatch, capsys, arguments, code, words
):
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "none", ignore_errors=True)
    filled = [made if argument == "A" else argument for argument in arguments]
    assert main(filled) == code
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
