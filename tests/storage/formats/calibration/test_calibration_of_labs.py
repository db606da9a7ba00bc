"""Calibrations as labs have them: other tables and names, other studios, far too many cameras."""

from dataclasses import replace

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.calibration.reading import read_calibration
from tests.figures import calibration_files as files
from tests.figures.calibration_files import rig
from tests.storage.formats.calibration.test_calibration import assert_same


def test_tables_of_a_toml_that_are_no_cameras_are_passed_over_with_a_word(tmp_path):
    path = files.write_pose2sim(tmp_path, rig())
    path.write_text(path.read_text() + "\n[charuco]\nrows = 5\n[[board]]\nsize = [3.0, 4.0]\n")
    read, notes = read_calibration(path)
    assert_same(read, rig())
    assert "The calibration has 'charuco', 'board', which is no camera: passed over." in notes


@pytest.mark.data
def test_a_calibration_with_a_board_is_read(shared_data):
    read, notes = read_calibration(shared_data / "reports" / "R14" / "calibration.toml")
    assert [camera.name for camera in read] == [f"cam{n}" for n in range(1, 9)]
    assert "The calibration has 'charuco', which is no camera: passed over." in notes


@pytest.mark.data
def test_hybrid_cameras_of_qualisys_film(shared_data):
    read, notes = read_calibration(shared_data / "reports" / "R13" / "some_hybrid.qca.txt")
    assert [camera.name for camera in read] == [f"cam{n}" for n in range(1, 9)]
    assert not any("left out" in note for note in notes)


def test_opencv_names_with_values_behind_are_read(tmp_path):
    cameras = [replace(camera, name=f"c{camera.name}") for camera in rig()]
    keys = ("CameraMatrix", "DistortionCoeffs", "RotationValues", "TranslationValues")
    read, _ = read_calibration(files.write_opencv(tmp_path, cameras, suffix=".xml", keys=keys))
    assert_same(read, cameras)


@pytest.mark.data
def test_the_real_rig_reads_from_its_files_of_opencv(shared_data, tmp_path):
    for camera in ("cam1", "cam2", "cam3", "cam4"):
        source = shared_data / "rigs" / "bini" / camera / "config.xml"
        (tmp_path / f"{camera}.xml").write_bytes(source.read_bytes())
    read, _ = read_calibration(tmp_path, up="z")
    assert [camera.name for camera in read] == ["cam1", "cam2", "cam3", "cam4"]
    assert all(2.0 < np.linalg.norm(camera.center_m) < 8.0 for camera in read)
    assert all(camera.center_m[1] > 0.3 for camera in read)


def test_every_name_of_an_opencv_file_is_listed_where_none_fits(tmp_path):
    names = [f"matter_{n}" for n in range(20)]
    text = "".join(f"{name}: 1\n" for name in names) + "lens:\n  optics: 3\n"
    (tmp_path / "a.yml").write_text(text)
    with pytest.raises(InputError, match="no intrinsic matrix") as caught:
        read_calibration(tmp_path / "a.yml")
    assert all(f"'{name}'" in str(caught.value) for name in [*names, "lens/optics"])


@pytest.mark.parametrize(
    ("keys", "lacking"),
    [(("K", "D", "Turn", "T"), "rotation"), (("K", "D", "rvec", "Where"), "translation"),
     (("K", "D", "Turn", "Where"), "rotation and no translation")],
)  # fmt: skip
def test_names_are_listed_where_rotation_or_translation_are_called_otherwise(
    tmp_path, keys, lacking
):
    folder = files.write_opencv(tmp_path, rig(), keys=keys)
    with pytest.raises(InputError, match=rf"has no {lacking} under a usual name: found are .*"
                                         rf"'{keys[2]}', '{keys[3]}'; wanted are"):  # fmt: skip
        read_calibration(folder)


@pytest.mark.parametrize("layout", ["rows first", "columns first", "in a folder"])
@pytest.mark.parametrize("orders", [0, 1, 3])
def test_surrey_calibrations_are_read(tmp_path, layout, orders):
    bent = (-0.11, 0.03, 0.0, 0.0, 0.004)
    kept = np.where(np.arange(5) < {0: 0, 1: 1, 3: 5}[orders], bent, 0.0)
    cameras = [replace(camera, distortion=kept) for camera in rig()]
    path = files.write_surrey(
        tmp_path, cameras, orders=orders, rows_first=layout != "columns first"
    )
    read, notes = read_calibration(tmp_path if layout == "in a folder" else path)
    named = [replace(camera, name=f"cam{n}") for n, camera in enumerate(cameras, start=1)]
    assert_same(read, named)
    assert not any("unit" in note for note in notes)


def test_cut_surrey_calibrations_are_refused(tmp_path):
    path = files.write_surrey(tmp_path, rig(), orders=1)
    path.write_text(path.read_text().rsplit(maxsplit=1)[0])
    with pytest.raises(InputError, match="no calibration that can be read"):
        read_calibration(path)


def pose2sim_of(count):
    camera = files.rig()[0]
    lines = (
        f"[c{n}]\nmatrix = {camera.intrinsics.tolist()}\nrotation = [0, 0, 0]\n"
        "translation = [0, 0, 1]\n"
        for n in range(count)
    )
    return "".join(lines)


def test_a_thousand_cameras_are_read_and_more_are_refused(tmp_path):
    (tmp_path / "a.toml").write_text(pose2sim_of(1000))
    assert len(read_calibration(tmp_path / "a.toml", unit_m=1.0)[0]) == 1000
    (tmp_path / "a.toml").write_text(pose2sim_of(1001))
    with pytest.raises(InputError, match="it has 1,001 cameras, at most 1,000 are read"):
        read_calibration(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text(pose2sim_of(20_000))
    with pytest.raises(InputError, match=r"has [\d,]+ letters, at most 2,097,152 are read"):
        read_calibration(tmp_path / "a.toml")
    (tmp_path / "a.yml").write_bytes(b"#" * (1 << 24))
    with pytest.raises(InputError, match="is longer than 4,194,304 bytes"):
        read_calibration(tmp_path / "a.yml")


def test_a_folder_of_far_too_many_files_is_refused_unread(tmp_path):
    for number in range(1001):
        (tmp_path / f"{number}.txt").touch()
    with pytest.raises(InputError, match="holds 1,001 files, where at most 1,000 cameras are read"):
        read_calibration(tmp_path)
