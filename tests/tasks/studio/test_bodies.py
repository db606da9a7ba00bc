import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.studio.dancing.choreography import freely, okuri48
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.performances import SH, generate_performance
from tasks.studio.stage.bodies import CHECKS, SEGMENTS, SKIN, pose_surface

ENDS = ("Head", "RFin", "LFin", "RHeel", "LHeel", "RFoot", "LFoot")
BONES = {
    "Head": ("Neck", "Head"),
    "Body": ("Waist", "Neck"),
    "RUpperArm": ("RShoulder", "RElbow"),
    "LForeArm": ("LElbow", "LWrist"),
    "RUpperLeg": ("RHip", "RKnee"),
    "LLowerLeg": ("LKnee", "LAnkle"),
}


@pytest.fixture(scope="module")
def joints():
    danced = generate_performance([okuri48(), freely(3)], SH, rate_hz=3.0, heading=0.7).position
    track = stretch_arms_first(danced, 3.0, still_s=0.4, blend_s=0.0)
    return dict(zip(JOINTS, np.moveaxis(track[::4], 1, 0), strict=True))


@pytest.fixture(scope="module", params=["fitting", "kimono"])
def surface(request, joints):
    return pose_surface(joints, clothes=request.param)


def corners(surface, frame):
    return np.moveaxis(surface.vertex[frame, surface.triangle].astype(float), 1, 0)


def winding_number(point, a, b, c):
    """Van Oosterom and Strackee (1983): the solid angle of each triangle."""
    a, b, c = a - point, b - point, c - point
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return np.sum(2.0 * np.arctan2(above, below)) / (4.0 * np.pi)


def test_a_surface_is_closed_and_turned_outward(surface):
    edges = surface.triangle[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    assert {(b, a) for a, b in forward} == forward
    a, b, c = corners(surface, 0)
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    assert 0.04 < parts.sum() < 0.25


def test_joints_lie_inside_the_surface(surface, joints):
    frames = len(joints["Head"])
    assert frames > 3
    for frame in range(frames):
        sides = corners(surface, frame)
        for name in set(JOINTS) - set(ENDS):
            assert winding_number(joints[name][frame], *sides) > 0.9, (name, frame)
        beside = joints["Waist"][frame] + [0.0, 0.0, 3.0]
        assert abs(winding_number(beside, *sides)) < 0.01


def test_ends_of_the_body_lie_on_its_surface(surface, joints):
    for name in ENDS:
        apart = np.linalg.norm(surface.vertex - joints[name][:, None], axis=-1).min(axis=1)
        assert apart.max() < 0.025, name


def test_no_one_sinks_into_the_floor(surface):
    assert -0.004 < surface.vertex[..., 1].min() < 0.02


def test_every_segment_stays_with_its_bone(surface, joints):
    assert set(surface.segment) == set(range(1, len(SEGMENTS) + 1))
    for name, (start, end) in BONES.items():
        own = (surface.segment == SEGMENTS.index(name) + 1) & ~surface.is_cloth
        a, bone = joints[start][:, None], (joints[end] - joints[start])[:, None]
        vertex = surface.vertex[:, own]
        share = np.clip(((vertex - a) * bone).sum(-1) / (bone**2).sum(-1), 0.0, 1.0)
        apart = np.linalg.norm(vertex - a - share[..., None] * bone, axis=-1)
        assert np.median(apart) < 0.18
        assert 0.01 < apart.max() < 0.21, name


def test_turning_a_performer_turns_the_surface(surface, joints):
    turn = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    clothes = "kimono" if surface.is_cloth.any() else "fitting"
    moved = {name: track @ turn.T + [1.0, 0.0, -2.0] for name, track in joints.items()}
    expected = surface.vertex @ turn.T + [1.0, 0.0, -2.0]
    np.testing.assert_allclose(pose_surface(moved, clothes=clothes).vertex, expected, atol=1e-5)


def test_a_larger_performer_is_thicker_in_proportion(joints):
    small = pose_surface(joints).vertex
    large = pose_surface({name: 1.2 * track for name, track in joints.items()}).vertex
    np.testing.assert_allclose(large, 1.2 * small, atol=1e-5)


def test_close_fitting_clothes_have_the_colors_of_their_segments(joints):
    surface = pose_surface(joints)
    label = surface.segment[surface.triangle[:, 0]]
    for name, colors in CHECKS.items():
        own = surface.color[label == SEGMENTS.index(name) + 1]
        for color in colors:
            assert (own == color).all(axis=1).mean() > 0.2, name
        strange = ~(own[:, None] == np.array(colors)).all(axis=2).any(axis=1)
        skin_or_shoe = 0.45 if name.endswith(("ForeArm", "LowerLeg")) else 0.0
        assert strange.mean() <= skin_or_shoe, name


def test_the_face_is_in_front_and_the_hair_behind(joints):
    surface = pose_surface(joints)
    left = joints["LShoulder"][0] - joints["RShoulder"][0]
    front = np.cross(left, joints["Head"][0] - joints["Neck"][0])
    head = surface.segment[surface.triangle[:, 0]] == 1
    middle = surface.vertex[0, surface.triangle[head]].mean(axis=1)
    upper = middle[:, 1] > 0.5 * (joints["Head"] + joints["Neck"])[0, 1]
    skin = (surface.color[head] == SKIN).all(axis=1)
    ahead = (middle - joints["Neck"][0]) @ front / np.linalg.norm(front)
    assert ahead[upper & skin].min() > 0.0
    assert ahead[upper & ~skin].min() < -0.06


def test_sleeves_hang_below_stretched_arms(joints):
    surface = pose_surface(joints, clothes="kimono")
    for side in "RL":
        sleeve = surface.is_cloth & (surface.segment == SEGMENTS.index(f"{side}ForeArm") + 1)
        below = joints[f"{side}Wrist"][0, 1] - surface.vertex[0, sleeve, 1]
        assert 0.35 < below.max() < 0.55
        assert below.min() > -0.1


def test_sleeves_of_a_furisode_hang_from_the_wrists_and_look_alike(joints):
    surface = pose_surface(joints, clothes="furisode")
    colors = []
    for side in "RL":
        own = surface.segment == SEGMENTS.index(f"{side}ForeArm") + 1
        middle = surface.vertex[:, surface.is_cloth & own].mean(axis=1)
        from_wrist, from_elbow = (
            np.linalg.norm((middle - joints[side + name])[:, [0, 2]], axis=1)
            for name in ("Wrist", "Elbow")
        )
        assert (from_wrist[:1] < from_elbow[:1]).all()  # the arms are stretched
        colors.append(np.unique(surface.color[own[surface.triangle[:, 0]]], axis=0))
    np.testing.assert_array_equal(*colors)


def test_a_skirt_reaches_from_the_waist_to_above_the_ankles(joints):
    surface = pose_surface(joints, clothes="kimono")
    skirt = surface.is_cloth & ~np.isin(surface.segment, [5, 7])
    height = surface.vertex[0, skirt, 1]
    assert abs(height.max() - joints["Waist"][0, 1]) < 0.03
    assert joints["RAnkle"][0, 1] < height.min() < joints["RKnee"][0, 1] - 0.2
    left = joints["LHip"][0] - joints["RHip"][0]
    for name, sign in (("RUpperLeg", -1.0), ("LLowerLeg", 1.0)):
        own = surface.vertex[0, skirt & (surface.segment == SEGMENTS.index(name) + 1)]
        assert sign * ((own - joints["Waist"][0]) @ left).mean() > 0.0


def test_a_joint_that_is_missing_or_lost_is_named(joints):
    lost = dict(joints, RKnee=np.where([[True, False, False]], np.nan, joints["RKnee"]))
    del lost["LFin"]
    with pytest.raises(ValueError, match="without RKnee, LFin; give a track whose 21 joints"):
        pose_surface(lost)


def test_unknown_clothes_are_refused(joints):
    with pytest.raises(ValueError, match="no clothes 'armor'; choose 'fitting', 'kimono' or"):
        pose_surface(joints, clothes="armor")
