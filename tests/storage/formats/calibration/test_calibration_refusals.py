"""What is wrong with a calibration is said in words, with the file and the camera."""

import json

import pytest

from storage.errors import InputError
from storage.formats.calibration.reading import read_calibration
from tests.figures import calibration_files as files
from tests.figures.calibration_files import rig


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fisheye = false", "fisheye = true", "camera 'cam_01': its lens is a fisheye"),
        ("size = [640.0", "size = [640.5", r"camera '01': the image size \[640.5, 480.0\] is no"),
        ("size = [640.0", "size = [-640.0", r"camera '01': the image size \(-640, 480\) is no"),
        ("translation", "position", "camera '01': it has no translation"),
        ("rotation", "R", "camera '01': it has no rotation"),
        ("rotation = [", "rotation = [70.0, ", r"camera '01': its rotation \[70.0.*9 finite"),
        ("rotation = [", "rotation = [0.0, 90.0, 0.0] #", "turns by more than two full turns"),
        ("rotation = [", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] #", "mirrors"),
        ("rotation = [", "rotation = [[1, 0, 0], [0, 1, 0], [0, 1, 1]] #", "at right angles"),
        ("translation = [", "translation = [nan, ", "translation .* is not 3 finite numbers"),
        ("matrix = [[", "matrix = [[-", "focal lengths -.* are not larger than 0"),
        ("matrix = [[", "matrix = [[0, 1, 0], [0, 1, 0], [0, 0, 0]] # ", "last element"),
        ("matrix = [[", "matrix = [[9, 0, 4], [1, 9, 4], [0, 0, 1]] # ", "not of the form"),
        ("matrix = [[", "matrix = 5 # ", "intrinsic matrix 5 is not 9 finite numbers"),
        ("distortions = [", 'distortions = ["a", ', "the distortion .* is no row of numbers"),
        ("distortions = [", "distortions = [0,0,0,0,0,0,0,0,", "at most 8"),
        ('name = "01"', 'name = "2"', "'2' is the name of more than one camera"),
        ('name = "01"', 'name = "a/b"', "the name 'a/b' cannot be that of a video file"),
        ("[metadata]", '[metadata]\nunit = "board"', "the unit 'board' is not known"),
        ("[metadata]", '[metadata]\nup = "w"', "up = 'w' is no axis"),
        ("matrix", "K", "has no camera: found are 'cam_01', 'cam_2', 'cam_side'; wanted is"),
        ("[cam_2]", "[cam_2", "is not TOML"),
    ],
)
def test_each_fault_of_a_toml_is_said_with_the_camera(tmp_path, old, new, message):
    path = files.write_pose2sim(tmp_path, rig())
    text = path.read_text()
    assert old in text
    count = -1 if message.startswith("has no camera") else 1
    path.write_text(text.replace(old, new, count))
    with pytest.raises(InputError, match=message) as caught:
        read_calibration(path)
    assert str(path) in str(caught.value)


def test_all_faults_are_said_at_once(tmp_path):
    path = files.write_pose2sim(tmp_path, rig())
    text = path.read_text().replace("translation", "t", 1).replace("matrix", "K", 1)
    path.write_text(text.replace('"2"\nsize = [640.0', '"2"\nsize = [0.0'))
    message = "'01': it has no intrinsic matrix; it has no translation; camera '2': the image size"
    with pytest.raises(InputError, match=message):
        read_calibration(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", "{", "is not JSON"),
        ("a.json", '{"cameras": 3}', "has no list 'cameras'"),
        ("a.json", '{"cameras": [{"name": "x"}]}', "camera 'x': it has no intrinsic matrix; it"),
        ("a.xml", "<x><y/></x>", "has a root <x>, which is not known"),
        ("a.xml", "<x", "is not XML"),
        ("a.xml", "<camera>1 2 3</camera>", "holds one camera; bring a folder"),
        ("a.txt", "1 2 3", r"no calibration that can be read: its name ends in '.txt' and it beg"),
        ("a.yml", "K: [1, 2\n", "the list of .* does not end"),
        ("a.yml", "what\n", "the line 'what' is not understood"),
        ("a.yml", "K: 1\nK: 2\n", "'K' comes more than once"),
        ("a.yml", "K:\n  rows: 3\n  cols: 3\n  data: [1]\n", "has 1 numbers, not 3 by 3 by 1"),
        ("a.yml", "K:\n  rows: 1\n  cols: 1\n  data: [x]\n", "the data of 'K' are not numbers"),
        ("a.yml", "K:\n  rows: x\n  cols: 1\n  data: [1]\n", "no number of rows and columns"),
        ("a.yml", "".join(" " * n + "a:\n" for n in range(40)), "more than 8 deep"),
        ("a.yml", "K: 1\n  2: 3\n", "the lines below 'K' are not understood"),
        ("a.xml", "<opencv_storage><K>1</K><K>1</K></opencv_storage>", "'K' comes more than once"),
        ("a.qca.txt", "<c><cameras><camera serial='7'/></cameras></c>", r"there is no <intrinsic>"),
        ("a.bin", b"\0\1", "holds binary data, not text"),
        ("a.toml", "", "is empty; bring a Pose2Sim"),
        ("none.toml", None, "cannot be read"),
    ],
)
def test_what_is_no_calibration_is_refused_in_words(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message):
        read_calibration(path)


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        ({}, "holds no calibration"),
        ({"a.txt": "1 2 3"}, "camera 'a': it has 3 numbers, not twelve"),
        ({"a.txt": "0 " * 12}, "camera 'a': its matrix is 0 or not finite"),
        ({"a.txt": "1 0 0 0 0 1 0 0 0 0 0 1"}, "infinitely far away"),
        ({"a.txt": "1 2", "b.json": "{}"}, "holds 'b.json', which is not twelve numbers"),
        ({"a.txt": "1 2", "a.xml": "<c>1</c>"}, "more than one file of a name"),
        ({"a.yml": "K: [1]", "b.yml": "x_K: [1]"}, "in b there is no intrinsic matrix"),
        ({"a.yml": "K_1: [1]", "b.yml": "K_1: [1]"}, "camera '1' comes in more than one file"),
        ({"cameras.txt": "1 FOV 6 4 1", "images.txt": "#\n"}, "lens model 'FOV' cannot be used"),
        ({"cameras.txt": "1 PINHOLE 6 4 1", "images.txt": "#\n"}, "has 3 numbers, 6 are wanted"),
        ({"cameras.txt": "#\n", "images.txt": "#\n"}, "there is no camera in it"),
        ({"cameras.txt": "#\n", "images.txt": "1 2 3\n"}, "the line '1 2 3' of images.txt is not"),
        ({"cameras.txt": "#\n", "images.txt": "1 1 0 0 0 0 0 0 7 a.png\n"}, "camera 7, which cam"),
        ({"intri.yml": "a: 1\n", "extri.yml": "b: 1\n"}, "no K_<camera>: found are 'a'"),
    ],
)
def test_a_folder_that_is_no_calibration_is_refused_in_words(tmp_path, contents, message):
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_calibration(tmp_path)


def test_a_camera_without_fields_in_a_panoptic_file_is_named(tmp_path):
    path = files.write_panoptic(tmp_path, rig())
    data = json.loads(path.read_text())
    del data["cameras"][2]["R"]
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"camera 'side': it has no rotation$"):
        read_calibration(path)
