"""Every format of calibrations gives back the cameras that were written, or says why not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.calibration.opencv import cameras_in
from storage.formats.calibration.reading import read_calibration, write_calibration
from tests.figures import calibration_files as files
from tests.figures.calibration_files import NAMES, in_z_up, rig


def assert_same(read, written, *, tolerance=1e-9):
    """Names, sizes and numbers agree; the numbers of a world in metres."""
    assert [camera.name for camera in read] == [camera.name for camera in written]
    for camera, other in zip(read, written, strict=True):
        assert camera.size in (other.size, None)
        np.testing.assert_allclose(camera.intrinsics, other.intrinsics, rtol=tolerance, atol=1e-6)
        np.testing.assert_allclose(camera.rotation, other.rotation, atol=tolerance)
        np.testing.assert_allclose(camera.translation, other.translation, atol=tolerance)
        size = max(len(camera.distortion), len(other.distortion))
        bent, wanted = (
            np.pad(each.distortion, (0, size - len(each.distortion))) for each in (camera, other)
        )
        np.testing.assert_allclose(bent, wanted, atol=tolerance)


STRAIGHT = ()

FORMATS = {
    "pose2sim": (lambda folder, cameras: files.write_pose2sim(folder, cameras), None),
    "easymocap": (lambda folder, cameras: files.write_easymocap(folder, cameras), None),
    "opencv yaml": (lambda folder, cameras: files.write_opencv(folder, cameras), None),
    "qualisys": (lambda folder, cameras: files.write_qualisys(folder, cameras), None),
    "panoptic": (lambda folder, cameras: files.write_panoptic(folder, cameras), None),
    "colmap": (lambda folder, cameras: files.write_colmap(folder, cameras), None),
    "matrices xml": (lambda folder, cameras: files.write_matrices(folder, cameras), STRAIGHT),
    "matrices text": (
        lambda folder, cameras: files.write_matrices(folder, cameras, suffix=".txt"), STRAIGHT,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", FORMATS)
def test_the_cameras_written_are_read_back(tmp_path, kind):
    write, distortion = FORMATS[kind]
    cameras = rig() if distortion is None else rig(distortion)
    read, _ = read_calibration(write(tmp_path, cameras))
    assert_same(read, cameras, tolerance=1e-7)


@pytest.mark.parametrize("kind", ["easymocap", "colmap"])
def test_a_pair_of_files_is_read_from_either_of_them_and_from_their_folder(tmp_path, kind):
    path = FORMATS[kind][0](tmp_path, rig())
    other = {"extri.yml": "intri.yml", "images.txt": "cameras.txt"}[path.name]
    for where in (path, path.with_name(other), tmp_path):
        assert_same(read_calibration(where)[0], rig(), tolerance=1e-7)
    path.unlink()
    with pytest.raises(InputError, match=rf"has no {path.name}; .* belong together"):
        read_calibration(path.with_name(other))


@pytest.mark.parametrize("layout", ["both", "vector", "matrix", "vector under Rot_"])
def test_easymocap_rotations_are_told_by_their_shape(tmp_path, layout):
    read, _ = read_calibration(files.write_easymocap(tmp_path, rig(), layout=layout))
    assert_same(read, rig())
    assert [camera.name for camera in read] == list(NAMES)


def test_easymocap_without_sizes_leaves_them_open(tmp_path):
    read, _ = read_calibration(files.write_easymocap(tmp_path, rig(), with_size=False))
    assert [camera.size for camera in read] == [None] * 3
    with pytest.raises(ValueError, match="the image size of camera '01' is not known"):
        read[0].width  # noqa: B018


def test_easymocap_rotations_that_differ_are_refused(tmp_path):
    path = files.write_easymocap(tmp_path, rig())
    swap = {"Rot_2:": "Rot_side:", "Rot_side:": "Rot_2:"}
    words = path.read_text().splitlines()
    for number, line in enumerate(words):
        head = line.split(" ")[0]
        words[number] = line.replace(head, swap[head]) if head in swap else line
    path.write_text("\n".join(words) + "\n")
    with pytest.raises(InputError, match=r"camera 'side': its two rotations.*differ"):
        read_calibration(path)


def test_easymocap_leading_zeros_count(tmp_path):
    path = files.write_easymocap(tmp_path, rig())
    path.write_text(path.read_text().replace('"01"', '"1"').replace("_01:", "_1:"))
    with pytest.raises(InputError, match=r"'01' is in intri.yml but not in extri.yml"):
        read_calibration(path)


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml"])
@pytest.mark.parametrize(
    "keys",
    [("camera_matrix", "distortion_coefficients", "R", "T"), ("K", "D", "rvec", "tvec"),
     ("cameraMatrix", "distCoeffs", "R", "t"), ("intrinsic_matrix", "dist", "rvec", "translation")],
)  # fmt: skip
def test_opencv_files_are_read_under_usual_names(tmp_path, suffix, keys):
    cameras = [replace(camera, name=f"c{camera.name}") for camera in rig()]
    read, _ = read_calibration(files.write_opencv(tmp_path, cameras, suffix=suffix, keys=keys))
    assert_same(read, cameras)


def test_opencv_files_with_a_table_a_camera_and_with_a_pose_matrix_are_read(tmp_path):
    path = tmp_path / "all.yml"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for camera in rig():
        file.startWriteStruct(f"cam{camera.name}", cv2.FILE_NODE_MAP)
        file.write("K", camera.intrinsics)
        file.write("dist_coeffs", camera.distortion[None])
        file.write("extrinsics", np.column_stack([camera.rotation, camera.translation]))
        file.endWriteStruct()
    file.release()
    read, _ = read_calibration(path)
    assert_same(read, [replace(camera, name=f"cam{camera.name}") for camera in rig()])


def test_opencv_names_that_are_not_usual_are_listed(tmp_path):
    folder = files.write_opencv(tmp_path, rig(), keys=("my_lens", "bent", "R", "T"))
    with pytest.raises(InputError, match=r"no intrinsic matrix.*found are .*'my_lens'.*wanted are"):
        read_calibration(folder)


def test_a_key_belongs_to_the_camera_behind_its_last_known_name():
    entries = {"camera_matrix_cam_1": 1.0, "dist_coeffs_cam_1": 2.0, "R_cam_1": 3.0, "note_x": 4.0}
    assert cameras_in(entries, "x") == {
        "cam_1": {"intrinsics": 1.0, "distortion": 2.0, "rotation": 3.0}
    }


def test_of_two_usual_names_the_more_usual_counts():
    entries = {"D_1": 1.0, "dist_1": 2.0, "K_1": 3.0, "intrinsic_1": 4.0}
    assert cameras_in(entries, "x") == {"1": {"distortion": 2.0, "intrinsics": 3.0}}


@pytest.mark.parametrize("line", ["names:\n- 01\n- 2\n- side\n", 'names: [01, "2", side]\n'])
def test_easymocap_names_without_quotes_keep_their_zeros(tmp_path, line):
    path = files.write_easymocap(tmp_path, rig())
    for file in (path, path.with_name("intri.yml")):
        head, _, rest = file.read_text().partition('names:\n  - "01"\n  - "2"\n  - "side"\n')
        file.write_text(head + line + rest)
    assert_same(read_calibration(path)[0], rig())


def test_easymocap_matrices_of_cameras_that_are_not_listed_are_left_out(tmp_path):
    path = files.write_easymocap(tmp_path, rig())
    for file in (path, path.with_name("intri.yml")):
        file.write_text(file.read_text().replace('  - "2"\n', ""))
    assert_same(read_calibration(path)[0], [rig()[0], rig()[2]])


def test_rotations_of_three_digits_are_taken_for_the_nearest_rotation(tmp_path):
    path = files.write_easymocap(tmp_path, rig(), layout="matrix", digits=3)
    for camera, exact in zip(read_calibration(path)[0], rig(), strict=True):
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(camera.rotation, exact.rotation, atol=2e-3)


def test_qualisys_cameras_that_see_only_markers_are_left_out_with_a_word(tmp_path):
    _, notes = read_calibration(files.write_qualisys(tmp_path, rig()))
    assert "1 of the 4 cameras see only markers: left out." in notes


def test_qualisys_crops_and_portrait_cameras_are_understood(tmp_path):
    cameras = rig()
    matrix = np.array([[520.0, 0, 321.0], [0, 510.0, 541.0], [0, 0, 1]])
    cameras[1] = replace(cameras[1], size=(640, 1100), intrinsics=matrix)
    matrix = np.array([[520.0, 0, 571.0], [0, 510.0, 301.0], [0, 0, 1]])
    cameras[2] = replace(cameras[2], size=(1100, 480), intrinsics=matrix)
    read, notes = read_calibration(files.write_qualisys(tmp_path, cameras, swapped=["side"]))
    assert_same(read, cameras, tolerance=1e-7)
    assert "Camera 'side' is portrait: its U and V were exchanged." in notes
    assert not any("'2'" in note for note in notes)
    read, _ = read_calibration(files.write_qualisys(tmp_path, cameras, offset=(96, 24)))
    assert_same(read, cameras, tolerance=1e-7)


def test_colmap_images_may_lie_in_a_folder_a_camera(tmp_path):
    path = files.write_colmap(tmp_path, rig(), model="PINHOLE")
    text = path.read_text()
    for name in NAMES:
        text = text.replace(f"{name}.png", f"{name}/frame 000.png")
    path.write_text(text)
    assert_same(read_calibration(path)[0], rig(STRAIGHT), tolerance=1e-7)


def test_colmap_images_in_one_folder_are_named_by_themselves(tmp_path):
    path = files.write_colmap(tmp_path, rig())
    text = path.read_text()
    for name in NAMES:
        text = text.replace(f"{name}.png", f"rig/{name}.png")
    path.write_text(text)
    assert_same(read_calibration(path)[0], rig(), tolerance=1e-7)


@pytest.mark.parametrize("unit", [("metres", 1.0), ("centimetres", 0.01), ("millimetres", 0.001)])
@pytest.mark.parametrize("center_m", [None, (0.1, 1.0, -0.2)])
@pytest.mark.parametrize("write", [files.write_pose2sim, files.write_easymocap, files.write_opencv])
def test_a_unit_that_is_not_said_is_inferred_and_said(tmp_path, write, unit, center_m):
    name, unit_m = unit
    path = write(tmp_path, rig(), scale=1 / unit_m)
    read, notes = read_calibration(path, center_m=center_m)
    assert_same(read, rig())
    assert any(f"does not say its unit: read as {name}, which puts" in note for note in notes)


def test_a_unit_that_is_given_is_not_inferred(tmp_path):
    path = files.write_pose2sim(tmp_path, rig(), scale=1 / 0.03)
    read, notes = read_calibration(path, unit_m=0.03)
    assert_same(read, rig())
    assert notes == []


def test_a_unit_in_the_file_is_taken(tmp_path):
    path = files.write_pose2sim(tmp_path, rig(), scale=10.0, metadata='unit = "dm"\nup = "y"\n')
    read, notes = read_calibration(path)
    assert_same(read, rig())
    assert notes == []


def in_world_of_z_up(cameras):
    return [
        replace(camera, rotation=in_z_up(camera)[0], translation=in_z_up(camera)[1])
        for camera in cameras
    ]


@pytest.mark.parametrize("up", ["z", None])
def test_a_world_of_z_up_is_turned(tmp_path, up):
    path = files.write_pose2sim(tmp_path, in_world_of_z_up(rig()))
    read, notes = read_calibration(path, up=up)
    assert_same(read, rig())
    np.testing.assert_allclose(read[0].center_m, [3.5, 1.6, 0.4], atol=1e-12)
    said = "Nothing says which axis points up: z was taken, as the images stand upright along it."
    assert (said in notes) == (up is None)


def test_images_that_stand_along_another_axis_are_said(tmp_path):
    path = files.write_pose2sim(tmp_path, in_world_of_z_up(rig()))
    _, notes = read_calibration(path, up="y")
    assert any("stand upright along z, though y is said to point up" in note for note in notes)


def test_two_sayings_of_what_is_up_must_agree(tmp_path):
    path = tmp_path / "own.toml"
    write_calibration(path, rig())
    with pytest.raises(InputError, match="says that y points up, and z is asked for"):
        read_calibration(path, up="z")


def test_our_own_file_gives_back_every_bit_that_matters(tmp_path):
    cameras = [*rig(), replace(rig()[0], name='Kamera "é" 所作', size=None)]
    half_turn = np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]])
    cameras.append(replace(cameras[0], name="half", rotation=half_turn, distortion=np.zeros(0)))
    cameras.append(replace(cameras[0], name="eight", distortion=np.arange(1, 9) / 100))
    write_calibration(tmp_path / "own.toml", cameras)
    read, notes = read_calibration(tmp_path / "own.toml")
    assert_same(read, cameras, tolerance=1e-14)
    assert notes == []
    assert [file.name for file in tmp_path.iterdir()] == ["own.toml"]


def test_our_own_file_wants_a_name_a_camera(tmp_path):
    with pytest.raises(ValueError, match="called '01', '01'; give each a name of its own"):
        write_calibration(tmp_path / "own.toml", [rig()[0], rig()[0]])


@pytest.mark.data
def test_the_real_dancer_reads_from_its_matrices(shared_data):
    folder = shared_data / "dancer8" / "calibration"
    read, notes = read_calibration(folder, up="z")
    assert [camera.name for camera in read] == [f"cam{number:02}" for number in range(8)]
    for camera in read:
        text = (folder / f"{camera.name}.xml").read_text()
        given = np.array(text.split("<camera>")[1].split("</camera>")[0].split(), float)
        z_up = camera.rotation @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        again = camera.intrinsics @ np.column_stack([z_up, camera.translation])
        again *= np.linalg.norm(given) / np.linalg.norm(again)
        np.testing.assert_allclose(again.ravel(), given, atol=1e-6 * np.linalg.norm(given))
        matrix, rotation, *_ = cv2.decomposeProjectionMatrix(given.reshape(3, 4))
        np.testing.assert_allclose(camera.intrinsics, matrix / matrix[2, 2], atol=1e-6)
        np.testing.assert_allclose(z_up, rotation, atol=1e-9)
        assert 1.5 < camera.center_m[1] < 3.9
    assert any("read as metres" in note for note in notes)


@pytest.mark.data
@pytest.mark.parametrize("name", ["plain", "kimono", "spin", "martial"])
def test_the_rendered_captures_film_their_true_bodies(shared_data, name):
    cameras, _ = read_calibration(shared_data / "captures" / name / "calibration.toml", up="y")
    with np.load(shared_data / "captures" / f"{name}_truth.npz") as truth:
        masks = np.unpackbits(truth["masks"][0], axis=-1)
        points = truth["verts"][0].astype(float)
    for number, camera in enumerate(cameras):
        pixel, _ = cv2.projectPoints(
            points, cv2.Rodrigues(camera.rotation)[0], camera.translation, camera.intrinsics,
            camera.distortion,
        )  # fmt: skip
        column, row = np.rint(pixel.reshape(-1, 2)).astype(int).T
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        assert inside.mean() > 0.9
        wider = cv2.dilate(masks[number], np.ones((3, 3), np.uint8))
        assert wider[row[inside], column[inside]].mean() > 0.995


def test_points_as_channels_of_one_element_are_three_numbers(tmp_path):
    folder = files.write_opencv(tmp_path, rig())
    for path in folder.iterdir():
        text = path.read_text().replace("T: !!opencv-nd-matrix", "T: !!opencv-matrix")
        path.write_text(text.replace("sizes: [ 3 ]\n   dt: d", 'rows: 1\n   cols: 1\n   dt: "3d"'))
        assert "rows: 1" in path.read_text()
    assert_same(read_calibration(folder)[0], rig())
