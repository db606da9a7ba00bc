"""Skeletons fitted to tracks: exact where bones are constant, honest where they are not."""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.exporting.skeletons import (
    TOLERANCE_M,
    Skeleton,
    fit_skeleton,
    skeleton_positions,
)

FRAMES = 40
# A body of our own making: joint, parent, where it hangs in its parent's axes (m).
BODY = [
    ("Waist", "Hips", (0.0, 0.2, -0.01)),
    ("chest", "Waist", (0.0, 0.12, 0.02)),
    ("Neck", "chest", (0.0, 0.22, -0.02)),
    ("skull", "Neck", (0.0, 0.07, 0.01)),
    ("Head", "skull", (0.0, 0.12, 0.08)),
] + [
    (f"{side}{name}", parent if parent in ("chest", "Hips") else side + parent,
     (sign * x, y, z))
    for side, sign in (("R", -1), ("L", 1))
    for name, parent, (x, y, z) in [
        ("collar", "chest", (0.03, 0.19, -0.05)), ("Shoulder", "collar", (0.1, -0.02, 0.01)),
        ("Elbow", "Shoulder", (0.28, -0.02, 0.0)), ("Wrist", "Elbow", (0.22, 0.01, 0.07)),
        ("knuckle", "Wrist", (0.08, 0.0, 0.03)), ("Fin", "knuckle", (0.06, 0.0, 0.02)),
        ("Hip", "Hips", (0.09, -0.02, 0.0)), ("Knee", "Hip", (0.0, -0.37, 0.01)),
        ("Ankle", "Knee", (0.01, -0.45, -0.05)), ("Heel", "Ankle", (0.0, -0.05, -0.05)),
        ("ball", "Ankle", (0.0, -0.04, 0.1)), ("Foot", "ball", (0.0, 0.0, 0.06)),
    ]
]  # fmt: skip


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def turns(rng, most):
    """Rotations that change slowly, (time, 3, 3), by Rodrigues' formula."""
    phase, speed = rng.uniform(0, 6, 3), rng.uniform(0.02, 0.2, 3)
    vectors = np.sin(np.arange(FRAMES)[:, None] * speed + phase) * most
    rotations = np.empty((FRAMES, 3, 3))
    for n, (x, y, z) in enumerate(vectors):
        angle = np.sqrt(x * x + y * y + z * z)
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) / angle
        rotations[n] = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return rotations


@pytest.fixture
def dance(rng):
    """(time, 21, 3): every bone of BODY turns, collars, skull, palms and toes as well."""
    steps = rng.normal(0, 0.01, (FRAMES, 3))
    where = {"Hips": np.array([0, 0.9, 0]) + np.cumsum(steps, axis=0)}
    facing = {"Hips": turns(rng, 1.5)}
    for name, parent, offset in BODY:
        where[name] = where[parent] + facing[parent] @ np.array(offset)
        facing[name] = facing[parent] @ turns(rng, 0.7)
    return np.stack([where[joint] for joint in JOINTS], axis=1)


def largest(skeleton, position):
    """The largest distance between skeleton and track, joint by joint and frame by frame."""
    positions = skeleton_positions(skeleton)
    worst = 0.0
    for frame in range(len(position)):
        for n, joint in enumerate(JOINTS):
            if joint in skeleton.names and np.isfinite(position[frame, n]).all():
                fitted = positions[frame, skeleton.names.index(joint)]
                worst = max(worst, float(np.linalg.norm(fitted - position[frame, n])))
    return worst


def test_what_came_from_constant_bones_is_followed_exactly(dance):
    skeleton, error = fit_skeleton(dance, JOINTS)
    assert set(JOINTS) <= set(skeleton.names)
    assert largest(skeleton, dance) < 1e-9
    assert error.max_m < 1e-9


def test_the_bones_between_joints_that_do_not_stretch_are_the_true_ones(dance):
    skeleton, _ = fit_skeleton(dance, JOINTS)
    true = {name: np.linalg.norm(offset) for name, _, offset in BODY}
    for joint in ("RElbow", "LWrist", "RKnee", "LAnkle", "LHip", "Waist"):
        bone = skeleton.names.index(joint)
        extra = 0.0 if joint not in ("LHip", "Waist") else 0.03  # from the middle of the hips
        assert np.linalg.norm(skeleton.offset[bone]) == pytest.approx(true[joint], abs=1e-9 + extra)
    assert {"Spine", "RCollar", "Skull", "LPalm", "LToes"} <= set(skeleton.names)


def test_rotations_are_rotations_and_bones_stand_after_their_parents(dance):
    skeleton, _ = fit_skeleton(dance, JOINTS)
    product = skeleton.rotation @ skeleton.rotation.transpose(0, 1, 3, 2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(skeleton.rotation), 1.0, atol=1e-9)
    assert all(parent < bone for bone, parent in enumerate(skeleton.parents))
    assert skeleton.parents.count(-1) == 1


def test_at_rest_the_body_stands_with_its_arms_stretched(dance):
    skeleton, _ = fit_skeleton(dance, JOINTS)
    rest = Skeleton(
        skeleton.names,
        skeleton.parents,
        skeleton.offset,
        np.zeros((1, 3)),
        np.eye(3)[None, None].repeat(len(skeleton.names), axis=1),
    )
    at = dict(zip(rest.names, skeleton_positions(rest)[0], strict=True))
    assert at["LFin"][0] > at["LElbow"][0] > at["LShoulder"][0] > at["Neck"][0] - 1e-9
    assert at["RFin"][0] < at["RElbow"][0] < at["RShoulder"][0] < at["Neck"][0] + 1e-9
    assert at["Head"][1] > at["Neck"][1] > at["Waist"][1] > 0 > at["RKnee"][1] > at["RAnkle"][1]
    assert at["LFoot"][2] > at["LAnkle"][2] > at["LHeel"][2]


def test_where_bones_stretch_the_error_is_what_one_measures(dance, rng):
    noisy = dance + rng.normal(0, 0.01, dance.shape)
    skeleton, error = fit_skeleton(noisy, JOINTS)
    assert error.max_m == pytest.approx(largest(skeleton, noisy), rel=1e-9)
    assert 0.001 < error.mean_m < error.p95_m < error.max_m < 0.08
    # Aimed from where the fit ended, the errors of a limb do not add up.
    positions = skeleton_positions(skeleton)
    wrist = positions[:, skeleton.names.index("RWrist")] - noisy[:, JOINTS.index("RWrist")]
    assert np.median(np.linalg.norm(wrist, axis=1)) < 0.02


def test_a_change_within_the_tolerance_is_one_bone(dance):
    tall = dance.copy()
    knee, ankle = JOINTS.index("RKnee"), JOINTS.index("RAnkle")
    along = tall[:, ankle] - tall[:, knee]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tall[:, ankle] += along * np.linspace(-0.9, 0.9, FRAMES)[:, None] * TOLERANCE_M
    skeleton, error = fit_skeleton(tall, JOINTS)
    assert "RAnkleMiddle" not in skeleton.names
    assert 0.3 * TOLERANCE_M < error.max_m < 2 * TOLERANCE_M


@pytest.mark.parametrize(
    "missing",
    [["RHeel", "LHeel"], ["Waist"], ["Neck"], ["Waist", "Neck", "Head"], ["RKnee"],
     ["RShoulder", "RElbow"], ["LAnkle"], ["Head", "RFin", "LFin"]],
    ids=" ".join,
)  # fmt: skip
def test_a_joint_that_is_never_there_has_no_bone(dance, missing):
    partly = dance.copy()
    partly[:, [JOINTS.index(joint) for joint in missing]] = np.nan
    skeleton, error = fit_skeleton(partly, JOINTS)
    assert not set(missing) & set(skeleton.names)
    assert set(JOINTS) - set(missing) <= set(skeleton.names)
    assert error.max_m < 1e-3
    assert largest(skeleton, partly) == pytest.approx(error.max_m, abs=1e-12)


def test_gaps_are_crossed_and_do_not_count(dance, rng):
    partly = dance.copy()
    partly[rng.random(partly.shape[:2]) < 0.2] = np.nan
    partly[:6, JOINTS.index("LWrist")] = np.nan
    partly[10:14, JOINTS.index("RHip")] = np.nan
    skeleton, error = fit_skeleton(partly, JOINTS)
    assert np.isfinite(skeleton.rotation).all()
    assert np.isfinite(skeleton.root_position).all()
    assert error.max_m == pytest.approx(largest(skeleton, partly), rel=1e-9)
    elbow = JOINTS.index("LElbow")
    seen = np.isfinite(partly).all(axis=-1)
    whole = seen[:, elbow] & seen[:, [JOINTS.index("LHip"), JOINTS.index("RHip")]].all(axis=1)
    fitted = skeleton_positions(skeleton)[:, skeleton.names.index("LElbow")]
    assert np.median(np.linalg.norm(fitted - partly[:, elbow], axis=1)[whole]) < 0.02


def test_in_a_gap_a_joint_goes_with_the_hips(dance):
    jump = np.zeros((FRAMES, 1, 3))
    jump[:, 0, 1] = np.sin(np.linspace(0, np.pi, FRAMES))
    still = dance[:1] + jump
    partly = still.copy()
    partly[5:35, JOINTS.index("LWrist")] = np.nan
    skeleton, _ = fit_skeleton(partly, JOINTS)
    assert largest(skeleton, still) < 1e-9


def test_one_frame_that_is_off_does_not_make_the_bones_long(dance):
    off = dance.copy()
    off[7, JOINTS.index("Head")] += [0, 9.0, 0]
    skeleton, error = fit_skeleton(off, JOINTS)
    lengths = np.linalg.norm(skeleton.offset, axis=1)
    assert lengths[skeleton.names.index("Head")] < 0.2
    assert error.max_m > 8
    assert error.p95_m < 1e-6


def test_a_track_that_stands_still_or_hangs_upside_down_is_fitted(dance):
    still = np.repeat(dance[:1], 3, axis=0)
    for track in (still, still * [-1, -1, 1], dance[:1], np.zeros((2, 21, 3))):
        skeleton, error = fit_skeleton(track, JOINTS)
        assert np.isfinite(skeleton.rotation).all()
        assert error.max_m < 1e-9


@pytest.mark.parametrize(
    ("position", "joints", "message"),
    [
        (np.zeros((4, 3)), JOINTS, r"position is \(4, 3\), \(time, 21, 3\) is wanted"),
        (np.zeros((4, 3, 3)), ("RHip", "LHip", "Tail"), r"\['Tail'\] are no joints"),
        (np.zeros((4, 2, 3)), ("RHip", "Neck"), "hangs on both hips, and one is never there"),
    ],
)
def test_wrong_arguments_are_named(position, joints, message):
    with pytest.raises(ValueError, match=message):
        fit_skeleton(position, joints)
