"""Which names make which joints: each system's names, written here from its own documents."""

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.marker_choice import choose_points, place_joints
from tasks.motion.marker_sets import MARKER_SETS
from tasks.motion.virtual_joints import _RULES

FRAMES = 5
BODY = {
    "Head": (0.0, 1.65, 0.0),
    "Neck": (0.0, 1.4, 0.0),
    "Waist": (0.0, 1.05, 0.0),
    "Shoulder": (0.18, 1.38, 0.0),
    "Elbow": (0.45, 1.38, 0.0),
    "Wrist": (0.7, 1.38, 0.0),
    "Fin": (0.88, 1.38, 0.0),
    "Hip": (0.09, 0.95, 0.0),
    "Knee": (0.1, 0.52, -0.02),
    "Ankle": (0.11, 0.08, 0.0),
    "Heel": (0.11, 0.03, 0.06),
    "Foot": (0.11, 0.02, -0.19),
}
"""A body with its arms sideways that looks to -z: the right side, the left mirrored."""
BONES = {
    "CMU": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Spine",
        "Shoulder": "RightArm",
        "Elbow": "RightForeArm",
        "Wrist": "RightHand",
        "Fin": "RightHandIndex1 End",
        "Hip": "RightUpLeg",
        "Knee": "RightLeg",
        "Ankle": "RightFoot",
        "Foot": "RightToeBase End",
        "": "Hips LHipJoint RHipJoint LowerBack Spine1 Neck1 Head RightShoulder LThumb "
        "RightFingerBase RightHandIndex1 RightToeBase",
    },
    "DAZ": {
        "Head": "head End",
        "Neck": "neck",
        "Waist": "abdomen",
        "Shoulder": "rShldr",
        "Elbow": "rForeArm",
        "Wrist": "rHand",
        "Fin": "rMid2 End",
        "Hip": "rThigh",
        "Knee": "rShin",
        "Ankle": "rFoot",
        "Foot": "rFoot End",
        "": "hip chest head rCollar rButtock rThumb1 rMid1 rIndex1 rIndex2",
    },
    "MotionBuilder": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Spine",
        "Shoulder": "RightArm",
        "Elbow": "RightForeArm",
        "Wrist": "RightHand",
        "Fin": "RightHandMiddle3 End",
        "Hip": "RightUpLeg",
        "Knee": "RightLeg",
        "Ankle": "RightFoot",
        "Foot": "RightToeBase End",
        "": "Hips Spine1 Spine2 Spine3 Head RightShoulder RightHandThumb1 RightHandMiddle1",
    },
    "Mixamo": {
        "Head": "mixamorig:HeadTop_End",
        "Neck": "mixamorig:Neck",
        "Waist": "mixamorig:Spine",
        "Shoulder": "mixamorig:RightArm",
        "Elbow": "mixamorig:RightForeArm",
        "Wrist": "mixamorig:RightHand",
        "Fin": "mixamorig:RightHandMiddle4",
        "Hip": "mixamorig:RightUpLeg",
        "Knee": "mixamorig:RightLeg",
        "Ankle": "mixamorig:RightFoot",
        "Foot": "mixamorig:RightToe_End",
        "": "mixamorig:Hips mixamorig:Spine1 mixamorig:Spine2 mixamorig:Head "
        "mixamorig:RightShoulder mixamorig:RightToeBase mixamorig:RightHandThumb4",
    },
    "Bandai": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Spine",
        "Shoulder": "UpperArm_R",
        "Elbow": "LowerArm_R",
        "Wrist": "Hand_R",
        "Fin": "Hand_R End",
        "Hip": "UpperLeg_R",
        "Knee": "LowerLeg_R",
        "Ankle": "Foot_R",
        "Foot": "Toes_R End",
        "": "joint_Root Hips Chest Head Shoulder_R Toes_R",
    },
    "OptiTrack bones": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Ab",
        "Shoulder": "RUArm",
        "Elbow": "RFArm",
        "Wrist": "RHand",
        "Fin": "RHand End",
        "Hip": "RThigh",
        "Knee": "RShin",
        "Ankle": "RFoot",
        "Foot": "RToe End",
        "": "Hip Chest Head RShoulder RToe",
    },
    "3ds Max Biped": {
        "Head": "Bip01 HeadNub",
        "Neck": "Bip01 Neck",
        "Waist": "Bip01 Spine",
        "Shoulder": "Bip01 R UpperArm",
        "Elbow": "Bip01 R Forearm",
        "Wrist": "Bip01 R Hand",
        "Fin": "Bip01 R Finger2Nub",
        "Hip": "Bip01 R Thigh",
        "Knee": "Bip01 R Calf",
        "Ankle": "Bip01 R Foot",
        "Foot": "Bip01 R Toe0Nub",
        "": "Bip01",
    },
    "Rokoko": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Spine1",
        "Shoulder": "RightArm",
        "Elbow": "RightForeArm",
        "Wrist": "RightHand",
        "Fin": "RightFinger3Tip",
        "Hip": "RightThigh",
        "Knee": "RightShin",
        "Ankle": "RightFoot",
        "Foot": "RightToeTip",
        "": "Root Hips Spine2 Spine3 Spine4 Head RightShoulder LeftShoulder RightToe",
    },
    "Unreal mannequin": {
        "Head": "head End",
        "Neck": "neck_01",
        "Waist": "spine_01",
        "Shoulder": "upperarm_r",
        "Elbow": "lowerarm_r",
        "Wrist": "hand_r",
        "Fin": "middle_03_r End",
        "Hip": "thigh_r",
        "Knee": "calf_r",
        "Ankle": "foot_r",
        "Foot": "ball_r End",
        "": "root pelvis spine_02 spine_03 head clavicle_r clavicle_l ball_r ball_l thumb_01_l",
    },
    "Blender Rigify": {
        "Head": "DEF-spine.006 End",
        "Neck": "DEF-spine.004",
        "Waist": "DEF-spine.001",
        "Shoulder": "DEF-upper_arm.R",
        "Elbow": "DEF-forearm.R",
        "Wrist": "DEF-hand.R",
        "Fin": "DEF-f_middle.03.R End",
        "Hip": "DEF-thigh.R",
        "Knee": "DEF-shin.R",
        "Ankle": "DEF-foot.R",
        "Foot": "DEF-toe.R End",
        "": "DEF-spine DEF-spine.002 DEF-spine.003 DEF-spine.006 DEF-shoulder.R DEF-toe.R "
        "DEF-upper_arm.R.001 DEF-thigh.R.001",
    },
    "hip-knee-ankle bones": {
        "Head": "Head End",
        "Neck": "Neck",
        "Waist": "Chest",
        "Shoulder": "RightShoulder",
        "Elbow": "RightElbow",
        "Wrist": "RightWrist",
        "Fin": "RightWrist End",
        "Hip": "RightHip",
        "Knee": "RightKnee",
        "Ankle": "RightAnkle",
        "Foot": "RightToe End",
        "": "Hips Chest2 Head RightCollar RightToe",
    },
    "OpenPose": {
        "Neck": "Neck",
        "Head": "Head",
        "Shoulder": "RShoulder",
        "Elbow": "RElbow",
        "Wrist": "RWrist",
        "Hip": "RHip",
        "Knee": "RKnee",
        "Ankle": "RAnkle",
        "Heel": "RHeel",
        "Foot": "RBigToe",
        "": "CHip Nose RSmallToe",
    },
    "shosa": {joint: joint if joint in BODY else "" for joint in ("Head", "Neck", "Waist")}
    | {name: f"R{name}" for name in BODY if name not in ("Head", "Neck", "Waist")},
}
MARKERS = {
    "Plug-in Gait": "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LUPA LELB LFRM LWRA LWRB "
    "LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN LASI RASI LPSI RPSI LTHI LKNE LTIB LANK LHEE LTOE "
    "RTHI RKNE RTIB RANK RHEE RTOE",
    "FiLMBOX": "RFHD LBHD RBHD C7 T10 CLAV STRN RBAC LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO "
    "RUPA RELB RFRM RWRA RWRB RFIN LFWT RFWT LBWT RBWT LTHI LKNE LSHN LANK LHEE LTOE LMT5 RTHI "
    "RKNE RSHN RANK RHEE RTOE RMT5 LFHD",
    "OptiTrack markers": "HeadTop HeadFront HeadSide BackTop BackLeft BackRight Chest "
    "WaistLFront WaistRFront WaistLBack WaistRBack LShoulderTop LShoulderBack LUArmHigh "
    "LElbowOut LWristOut LWristIn LHandOut LHandIn LThigh LKneeOut LShin LAnkleOut LToeIn "
    "LToeOut LHeel RShoulderTop RShoulderBack RUArmHigh RElbowOut RWristOut RWristIn RHandOut "
    "RHandIn RThigh RKneeOut RShin RAnkleOut RToeIn RToeOut RHeel",
    "OpenSim": "RACR LACR C7 CLAV RASH RPSH LASH LPSH RASI LASI RPSI LPSI RLFC RMFC LLFC LMFC "
    "RLMAL RMMAL LLMAL LMMAL RCAL LCAL RTOE LTOE RMT5 LMT5 RLEL RMEL LLEL LMEL RFAradius "
    "RFAulna LFAradius LFAulna",
}
WITHOUT = {"OpenSim": {"Head", "RFin", "LFin"}}


def left(name):
    """The name of the other side, as these systems spell it."""
    sides = ("Right", "Left"), ("_R", "_L"), (" R ", " L "), ("_r", "_l"), (".R", ".L")
    for right, other in sides:
        if right in name:
            return name.replace(right, other)
    head, colon, tail = name.rpartition(":")
    return head + colon + {"R": "L", "r": "l"}.get(tail[0], tail[0]) + tail[1:]


def skeleton(bones):
    """Return names, positions and truth of a body of these bones, in a mixed-up order."""
    truth, at = {}, {}
    for joint, name in bones.items():
        if joint and joint in JOINTS:
            truth[joint], at[name] = BODY[joint], BODY[joint]
        elif joint:
            x, y, z = BODY[joint]
            truth[f"R{joint}"], at[name] = (x, y, z), (x, y, z)
            truth[f"L{joint}"], at[left(name)] = (-x, y, z), (-x, y, z)
    for name in bones.get("", "").split():
        at.setdefault(name, (9.0, 9.0, 9.0))
    names = sorted(at, key=lambda name: name[::-1])
    return tuple(names), np.tile([at[name] for name in names], (FRAMES, 1, 1)), truth


def choose(names, position, **more):
    return choose_points(names, np.isfinite(position[..., 0]), **more)


@pytest.mark.parametrize("system", BONES)
def test_bones_of_a_system_stand_where_its_joints_are(system):
    names, position, truth = skeleton(BONES[system])
    choice = choose(names, position)
    assert choice.marker_set == system
    assert set(truth) <= set(choice.joints)
    joints = place_joints(position, choice)
    for joint, there in truth.items():
        np.testing.assert_allclose(joints[0, JOINTS.index(joint)], there, err_msg=joint)


@pytest.mark.parametrize("system", MARKERS)
def test_markers_of_a_system_give_its_joints(system):
    names = tuple(MARKERS[system].split())
    choice = choose_points(names, np.ones((FRAMES, len(names)), bool))
    assert choice.marker_set == system
    assert set(JOINTS) - set(choice.joints) == WITHOUT.get(system, set())


@pytest.mark.parametrize(
    "spell",
    [
        lambda name: f"dancer:{name}",
        lambda name: f"Dancer 1:{name.lower()}",
        lambda name: f"Skeleton_001_{name}",
        lambda name: f" {name[0]}.{name[1:]} ",
    ],
    ids=["prefix", "lower case", "prefix with underscore", "punctuation"],
)
@pytest.mark.parametrize("system", MARKERS)
def test_prefix_case_and_punctuation_of_names_do_not_matter(system, spell):
    names = MARKERS[system].split()
    plain = choose_points(names, np.ones((FRAMES, len(names)), bool))
    spelled = choose_points([spell(name) for name in names], np.ones((FRAMES, len(names)), bool))
    assert spelled.recipes == plain.recipes
    assert spelled.marker_set == plain.marker_set


@pytest.mark.parametrize("root", ["", "World"])
@pytest.mark.parametrize("prefix", ["Model.", "Bip01 ", "Skeleton_001_", "a:b:", "Mesh.Bip01_"])
@pytest.mark.parametrize("system", ["CMU", "DAZ", "Unreal mannequin", "Blender Rigify"])
def test_words_that_begin_nearly_all_bones_do_not_matter(system, prefix, root):
    names, position, _ = skeleton(BONES[system])
    plain = choose(names, position)
    spelled = choose([prefix + name for name in names], position)
    assert (spelled.recipes, spelled.marker_set) == (plain.recipes, plain.marker_set)
    if root:
        more = np.concatenate([position, position[:, :1]], axis=1)
        spelled = choose([*(prefix + name for name in names), root], more)
        assert (spelled.recipes, spelled.marker_set) == (plain.recipes, plain.marker_set)


def test_every_point_of_a_table_is_a_joint_or_is_needed_by_a_rule():
    wanted = set(JOINTS) | {need for rule in _RULES for need in rule.needs}
    for marker_set in MARKER_SETS:
        assert set(marker_set.points) <= wanted, marker_set.name
        assert all(name for ways in marker_set.points.values() for way in ways for name in way)
