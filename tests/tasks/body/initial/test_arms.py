"""Arms, legs and labels of an initial model, each on a shape of its own."""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.body.anatomy.nearest_bones import label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.initial.arms import measure_arms
from tasks.body.initial.trunk import Trunk, lift_hips
from tasks.geometry.voxels import voxel_centers
from tests.figures.initial_figures import GRID, VOXEL, about_y, figure_of, with_arms


def test_arms_are_the_same_from_behind(stretched):
    swept = with_arms(stretched, {"R": about_y(0.2), "L": about_y(-0.1)})
    index = np.argwhere(figure_of(swept, "fitting").occupied)
    arms = measure_arms(voxel_centers(GRID, index), VOXEL)
    behind = arms.turned()
    for side in range(2):
        np.testing.assert_allclose(behind.along(1 - side, 0.7), arms.along(side, 0.7), atol=1e-9)
        np.testing.assert_array_equal(behind.tip[1 - side], arms.tip[side])


def test_labels_follow_groins_and_hanging_sleeves(stretched):
    joints = dict(zip(JOINTS, stretched, strict=True))
    across = joints["LHip"] - joints["RHip"]
    left, up = across / np.linalg.norm(across), np.array([0.0, 1.0, 0.0])
    middle = (joints["LHip"] + joints["RHip"]) / 2
    forearm = (joints["LElbow"] + joints["LWrist"]) / 2
    cases = {
        3: middle - 0.02 * up,  # between the legs the waist reaches lower,
        10: joints["LHip"] + 0.09 * left + 0.03 * up,  # and outside the leg reaches higher
        8: joints["RHip"] - 0.09 * left + 0.03 * up,
        7: forearm - 0.42 * up,
        1: joints["Head"] - 0.05 * up,
        9: joints["RFoot"],
    }
    label = label_points(np.array(list(cases.values())), complete_joints(joints))
    assert label.tolist() == list(cases)


def trunk_of(stature_m, hips=0.505):
    """Return an upright trunk whose hips are where proportions have them."""
    up = np.array([0.0, stature_m, 0.0])
    return Trunk(up, 0.85 * up, 0.66 * up, hips * up, stature_m)


@pytest.mark.parametrize(("stature_m", "usual"), [(1.1, 0.470), (1.8, 0.505)])
def test_hips_come_nearer_to_what_the_fork_of_the_legs_says(stature_m, usual):
    trunk = trunk_of(stature_m, usual)
    for off, moved in ((0.0, 0.0), (0.04, 0.04 * 100 / 136), (-0.03, -0.03 / 2)):  # of variances
        lifted = lift_hips(trunk, (usual - 0.075 + off) * stature_m)
        assert lifted.hips[1] / stature_m == pytest.approx(usual + moved)
        assert (lifted.hips[[0, 2]] == 0).all()
        np.testing.assert_allclose(
            lifted.waist, trunk.neck + 0.56 * (lifted.hips - trunk.neck), atol=1e-12
        )
        assert lifted.neck is trunk.neck
        assert lifted.head is trunk.head


@pytest.mark.parametrize("fork", [None, 0.05, 0.37, 0.51])
def test_a_hem_or_no_fork_leaves_the_hips(fork):
    trunk = trunk_of(1.7)
    assert lift_hips(trunk, fork and fork * 1.7) is trunk
