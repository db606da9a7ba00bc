"""A damaged calibration gives finite cameras or an `InputError` of one line; never a crash."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.errors import InputError
from storage.formats.calibration.reading import read_calibration
from tests.conftest import cases
from tests.figures import calibration_files as files
from tests.figures.calibration_files import rig
from tests.figures.strategies import damaged

many = settings(max_examples=cases(60))

WRITERS = {
    "pose2sim": files.write_pose2sim,
    "easymocap": files.write_easymocap,
    "opencv": files.write_opencv,
    "opencv xml": lambda folder, cameras: files.write_opencv(folder, cameras, suffix=".xml"),
    "qualisys": files.write_qualisys,
    "panoptic": files.write_panoptic,
    "colmap": files.write_colmap,
    "matrices": files.write_matrices,
}


@pytest.fixture(scope="module", params=WRITERS)
def calibration(request, tmp_path_factory):
    """(what to read, the file to damage, its bytes) of each format."""
    folder = tmp_path_factory.mktemp("calibration")
    prefix = "c" if request.param == "opencv xml" else ""
    cameras = rig(()) if request.param == "matrices" else rig()
    for camera in cameras:
        object.__setattr__(camera, "name", prefix + camera.name)
    path = WRITERS[request.param](folder, cameras)
    file = next(iter(sorted(path.iterdir()))) if path.is_dir() else path
    return path, file, file.read_bytes()


def read_or_refuse(path, file, data):
    """The cameras, checked for what every camera must be, or None where they were refused."""
    file.write_bytes(data)
    try:
        cameras, notes = read_calibration(path)
    except InputError as error:
        said = str(error)
    else:
        assert all(isinstance(note, str) and "\n" not in note for note in notes)
        check(cameras)
        return cameras
    assert str(path) in said or str(path.parent) in said
    assert len(said) < 4000
    assert "\n" not in said
    return None


def check(cameras):
    assert cameras
    assert len({camera.name for camera in cameras}) == len(cameras)
    for camera in cameras:
        for array in (camera.intrinsics, camera.distortion, camera.translation, camera.center_m):
            assert np.isfinite(array).all()
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=2e-6)
        assert (np.diag(camera.intrinsics) > 0).all()


@pytest.mark.drawn
@many
@given(data=st.data())
def test_a_damaged_calibration(calibration, data):
    path, file, whole = calibration
    read_or_refuse(path, file, data.draw(damaged(whole, head=len(whole))))


@pytest.mark.parametrize("name", ["x.toml", "x.yml", "x.xml", "x.json", "x.qca.txt"])
@pytest.mark.drawn
@many
@given(
    data=st.one_of(
        st.binary(max_size=300),
        st.text('<>/{}[]"=:,-.!01 eK_\n\t', max_size=200).map(str.encode),
    )
)
def test_any_bytes(tmp_path_factory, name, data):
    path = tmp_path_factory.getbasetemp() / name
    assert read_or_refuse(path, path, data) is None


def test_a_file_cut_anywhere_is_refused_or_has_whole_cameras(calibration):
    path, file, whole = calibration
    first = {camera.name: camera for camera in read_or_refuse(path, file, whole)}
    survived = 0
    for length in range(0, len(whole), 3):
        cameras = read_or_refuse(path, file, whole[:length])
        for camera in cameras or []:
            survived += 1
            wanted = first[camera.name].intrinsics if camera.name in first else None
            # a cut after a table, a line or a last digit leaves what is a whole file
            if wanted is not None:
                np.testing.assert_allclose(camera.intrinsics, wanted, rtol=1e-6)
    file.write_bytes(whole)
    assert survived < 0.5 * len(whole)
