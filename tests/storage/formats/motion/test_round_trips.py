"""What is written is read again: 0.01 mm for TRC, C3D and CSV, 1 mm for what came from BVH."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from storage.formats import read_motion_file
from storage.formats.motion.bvh import write_bvh
from storage.formats.motion.c3d import write_c3d
from storage.formats.motion.joint_csv import write_joint_csv
from storage.formats.motion.trc import write_trc
from storage.schema import JOINTS
from tasks.exporting.skeletons import fit_skeleton
from tests.conftest import cases
from tests.figures.strategies import tracks

HUNDREDTH_MM = 1e-5
DAZ = {
    "Head": "leftEye End", "Neck": "neck", "Waist": "abdomen",
    **{f"{side}{joint}": f"{side.lower()}{bone}"
       for side in "RL"
       for joint, bone in (
           ("Shoulder", "Shldr"), ("Elbow", "ForeArm"), ("Wrist", "Hand"), ("Fin", "Mid2 End"),
           ("Hip", "Thigh"), ("Knee", "Shin"), ("Ankle", "Foot"), ("Foot", "Foot End"))},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("round")


def read_csv(path: Path):
    """The columns of a CSV as (time, joint, 3), the joints' names and the times."""
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    names = tuple(name.removesuffix("_x") for name in head[1::3])
    assert head == ["time", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    return table[:, 1:].reshape(len(rows), -1, 3), names, table[:, 0]


@pytest.mark.parametrize(
    ("write", "suffix"), [(write_trc, ".trc"), (write_c3d, ".c3d")], ids=["trc", "c3d"]
)
@pytest.mark.drawn
@settings(max_examples=cases(30))
@given(track=tracks())
def test_a_track_with_gaps_comes_back(folder, write, suffix, track):
    position, names, rate_hz = track
    write(folder / f"track{suffix}", position, names, rate_hz)
    motion = read_motion_file(folder / f"track{suffix}")
    assert (motion.names, motion.unit_m, motion.notes) == (tuple(names), 0.001, ())
    assert motion.rate_hz == pytest.approx(rate_hz, rel=1e-6)
    np.testing.assert_allclose(motion.position / 1000, position, rtol=0, atol=HUNDREDTH_MM)


@pytest.mark.drawn
@settings(max_examples=cases(15))
@given(track=tracks())
def test_a_csv_holds_the_track(folder, track):
    position, names, rate_hz = track
    write_joint_csv(folder / "track.csv", position, names, rate_hz)
    read, joints, time_s = read_csv(folder / "track.csv")
    assert joints == tuple(names)
    np.testing.assert_allclose(read, position, rtol=0, atol=HUNDREDTH_MM)
    np.testing.assert_allclose(time_s, np.arange(len(position)) / rate_hz, atol=1e-8)


def test_the_cells_of_a_gap_are_empty(folder):
    position = np.array([[[1, 2, 3], [4, 5, 6]], [[1, 2, np.nan], [4, 5, 6]]])
    write_trc(folder / "gap.trc", position, ["A", "B"], 50.0)
    write_joint_csv(folder / "gap.csv", position, ["A", "B"], 50.0)
    trc, table = ((folder / f"gap.{end}").read_text().splitlines()[-1] for end in ("trc", "csv"))
    assert trc == "2\t0.02\t\t\t\t4000.00000\t5000.00000\t6000.00000"
    assert table == "0.02,,,,4.00000000,5.00000000,6.00000000"


@pytest.mark.data
@pytest.mark.parametrize(
    "name",
    ["c3d/Eb015pi.c3d", "c3d/PiG_Motion-FlatFoot-Full.c3d", "c3d/walkingOptiTrack.c3d",
     "c3d/badParameterOffset.c3d", "trc/ballet_reduced.trc"],
)  # fmt: skip
def test_recorded_markers_come_back_from_every_format(shared_data, folder, name):
    motion = read_motion_file(shared_data / name)
    position = motion.position * motion.unit_m
    for suffix, write in ((".trc", write_trc), (".c3d", write_c3d)):
        write(folder / f"markers{suffix}", position, motion.names, motion.rate_hz)
        again = read_motion_file(folder / f"markers{suffix}")
        assert (again.names, again.rate_hz) == (motion.names, motion.rate_hz)
        np.testing.assert_allclose(again.position / 1000, position, rtol=0, atol=HUNDREDTH_MM)
    write_joint_csv(folder / "markers.csv", position, motion.names, motion.rate_hz)
    table, names, _ = read_csv(folder / "markers.csv")
    assert names == motion.names
    np.testing.assert_allclose(table, position, rtol=0, atol=HUNDREDTH_MM)


@pytest.mark.data
@pytest.mark.parametrize("name", ["indian/indian_13", "salsa/salsa_20", "martial/martial_04"])
def test_joints_of_a_bvh_come_back_from_a_bvh_to_a_millimeter(shared_data, folder, name):
    motion = read_motion_file(shared_data / "mocap" / f"{name}.bvh")
    position = np.full((len(motion.position), len(JOINTS), 3), np.nan)
    for joint, bone in DAZ.items():
        position[:, JOINTS.index(joint)] = motion.position[:, motion.names.index(bone)] * 0.01
    skeleton, error = fit_skeleton(position, JOINTS)
    assert error.max_m < 0.001
    write_bvh(
        folder / "fitted.bvh",
        skeleton.names,
        skeleton.parents,
        skeleton.offset,
        skeleton.root_position,
        skeleton.rotation,
        motion.rate_hz,
    )
    again = read_motion_file(folder / "fitted.bvh")
    assert again.rate_hz == motion.rate_hz
    for joint in DAZ:
        read = again.position[:, again.names.index(joint)] / 100
        away = np.linalg.norm(read - position[:, JOINTS.index(joint)], axis=1)
        assert away.max() < 0.001, joint
