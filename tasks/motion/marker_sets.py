"""The names that marker systems and skeletons give to the points of the body.

A marker set is a table: for each point of the body (one of the 21 joints, or a landmark from
which `tasks.motion.virtual_joints` places joints) the names that give it. In a table, names
stand apart by spaces, the best first, `A+B` is the middle of both, and `{R}`, `{Right}` stand
for either side. Names are compared without case, punctuation and the performer's prefix
("subject:LASI", "mixamorig:Hips").
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from storage.schema import JOINTS

_FIRST_WORD = re.compile(r"[^\s._:-]+[\s._:-]+(?=\S)")
_SHARED = 0.8
"""The share of names that begin with a word which tells nothing. Chosen: sides share half of them,
and a root or two may stand apart."""


@dataclass(frozen=True)
class MarkerSet:
    """The names that one system gives to the points of the body."""

    name: str
    points: Mapping[str, tuple[tuple[str, ...], ...]]
    """For each point the ways to have it, best first: the names whose middle it is."""
    known: frozenset[str]
    """Every name of the set, used or not: what tells it from a set that is much alike."""


def bare_name(name: str) -> str:
    """Return a name without prefix, case and punctuation, as the tables compare it.

    Letters of every script and their marks stay: a name without Latin letters is a name too.
    """
    bare = unicodedata.normalize("NFC", name.rpartition(":")[2]).casefold()
    bare = "".join(letter for letter in bare if not _is_punctuation(letter))
    return bare.removeprefix("mixamorig") or name.strip()


def _is_punctuation(letter: str) -> bool:
    """Tell whether a letter is no part of a name: punctuation, a space, a sign of ASCII."""
    kind = unicodedata.category(letter)[0]
    return kind in "PZC" or (kind == "S" and letter.isascii())


def without_shared_prefixes(names: Sequence[str]) -> list[str]:
    """Return names without the words that begin nearly all of them ("Bip01 L Thigh").

    A word ends at a space or one of `.`, `_`, `:` and `-`. The root often has the word alone as
    its name, or has another.
    """
    bare = list(names)
    while True:
        words = Counter(found[0] for name in bare if (found := _FIRST_WORD.match(name)))
        word, count = next(iter(words.most_common(1)), ("", 0))
        if count < 2 or count < _SHARED * len(bare):
            return bare
        bare = [name.removeprefix(word) for name in bare]


def _marker_set(name: str, rows: dict[str, str], also: str = "") -> MarkerSet:
    """Write a table out for both sides; `also` are names of the set that nothing is made of."""
    points, known = {}, set()
    for side, word in (("r", "right"), ("l", "left")):
        spell = {"R": side, "Right": word}
        known.update(bare_name(other) for other in also.format(**spell).split())
        for point, text in rows.items():
            ways = tuple(
                tuple(bare_name(part) for part in way.split("+"))
                for way in text.format(**spell).split()
            )
            points[point.format(R=side.upper())] = ways
            known.update(part for way in ways for part in way)
    return MarkerSet(name, points, frozenset(known))


_JOINT_NAMES = {joint: joint for joint in JOINTS}

_TRUNK_AND_ARM_MARKERS = {
    "{R}FrontHead": "{R}FHD",
    "{R}BackHead": "{R}BHD",
    "C7": "C7",
    "Clavicle": "CLAV",
    "T10": "T10",
    "Sternum": "STRN",
    "{R}Acromion": "{R}SHO",
    "{R}ElbowLateral": "{R}ELB",
    "{R}ElbowMedial": "{R}ELBM {R}MEL {R}ELM",
    "{R}Knuckle": "{R}FIN",
    "{R}Asis": "{R}ASI {R}ASIS {R}FWT",
    "{R}Psis": "{R}PSI {R}PSIS {R}BWT",
    "Sacrum": "SACR SAC",
    "{R}ThighSide": "{R}THI",
    "{R}KneeLateral": "{R}KNE",
    "{R}KneeMedial": "{R}KNM {R}MKNE {R}KNEM",
    "{R}AnkleLateral": "{R}ANK",
    "{R}AnkleMedial": "{R}MMA {R}ANM {R}MANK {R}ANKM",
    "{R}Heel": "{R}HEE {R}HEEL",
}
_PLUG_IN_GAIT = {
    **_TRUNK_AND_ARM_MARKERS,
    "{R}Hip": "{R}HJC {R}FEP",
    "{R}Knee": "{R}KJC {R}FEO",
    "{R}Ankle": "{R}AJC {R}TIO",
    "{R}Shoulder": "{R}SJC {R}CLO",
    "{R}Elbow": "{R}EJC {R}HUO",
    "{R}Wrist": "{R}WJC {R}RAO {R}WRA+{R}WRB {R}WRI {R}WRA",
    "{R}ToeBase": "{R}TOE",
}
_FILMBOX = {
    **_TRUNK_AND_ARM_MARKERS,
    "{R}Wrist": "{R}WRA+{R}WRB {R}WRI {R}WRA",
    "{R}Foot": "{R}TOE",
}
_OPTITRACK_MARKERS = {
    "Head": "HeadTop",
    "C7": "BackTop",
    "Clavicle": "Chest",
    "{R}Acromion": "{R}ShoulderTop",
    "{R}ElbowLateral": "{R}ElbowOut",
    "{R}ElbowMedial": "{R}ElbowIn",
    "{R}Wrist": "{R}WristOut+{R}WristIn {R}WristOut",
    "{R}Knuckle": "{R}HandOut+{R}HandIn {R}HandOut",
    "{R}Asis": "Waist{R}Front {R}WaistFront",
    "{R}Psis": "Waist{R}Back {R}WaistBack",
    "{R}ThighSide": "{R}Thigh",
    "{R}KneeLateral": "{R}KneeOut",
    "{R}KneeMedial": "{R}KneeIn",
    "{R}AnkleLateral": "{R}AnkleOut",
    "{R}AnkleMedial": "{R}AnkleIn",
    "{R}Heel": "{R}Heel {R}HeelBack",
    "{R}Foot": "{R}ToeTip",
    "{R}ToeBase": "{R}ToeIn+{R}ToeOut {R}ToeIn {R}Toe",
}
_OPENSIM = {
    "Head": "TopHead HeadTop",
    "C7": "C7",
    "Clavicle": "CLAV Sternum",
    "{R}Shoulder": "{R}SJC {R}GHJC",
    "{R}Acromion": "{R}ACR {R}Acromium {R}Acromion {R}Shoulder",
    "{R}Elbow": "{R}EJC",
    "{R}ElbowLateral": "{R}LEL {R}Elbow {R}LElbow",
    "{R}ElbowMedial": "{R}MEL {R}MElbow",
    "{R}Wrist": "{R}WJC {R}FAradius+{R}FAulna {R}WristMed+{R}WristLat {R}LWrist+{R}MWrist",
    "{R}Hip": "{R}HJC",
    "{R}Asis": "{R}ASI {R}ASIS",
    "{R}Psis": "{R}PSI {R}PSIS",
    "Sacrum": "VSacral VSacrum SACR",
    "{R}ThighSide": "{R}ThighUpper",
    "{R}Knee": "{R}KJC",
    "{R}KneeLateral": "{R}LFC {R}KneeLat {R}Knee",
    "{R}KneeMedial": "{R}MFC {R}KneeMed {R}MKnee",
    "{R}Ankle": "{R}AJC",
    "{R}AnkleLateral": "{R}LMAL {R}AnkleLat {R}Ankle",
    "{R}AnkleMedial": "{R}MMAL {R}AnkleMed {R}MAnkle",
    "{R}Heel": "{R}CAL {R}Heel {R}Calc",
    "{R}Foot": "{R}ToeTip",
    "{R}ToeBase": "{R}TOE {R}ToeMed+{R}ToeLat",
}
_KEYPOINTS = {
    "Head": "Head HeadTop",
    "Neck": "Neck",
    "{R}Shoulder": "{R}Shoulder {Right}Shoulder",
    "{R}Elbow": "{R}Elbow {Right}Elbow",
    "{R}Wrist": "{R}Wrist {Right}Wrist",
    "{R}Fin": "{R}MiddleTip {R}Middle4 {R}IndexTip",
    "{R}Knuckle": "{R}Middle1 {R}Index {Right}Index",
    "{R}Hip": "{R}Hip {Right}Hip",
    "{R}Knee": "{R}Knee {Right}Knee",
    "{R}Ankle": "{R}Ankle {Right}Ankle",
    "{R}Heel": "{R}Heel {Right}Heel",
    "{R}Foot": "{R}BigToe {Right}BigToe {Right}FootIndex",
}
_SPINE_BONES = {"Neck": "Neck", "Head": "HeadTopEnd HeadEnd", "Skull": "Head"}
_MIXAMO = {
    **_SPINE_BONES,
    "Waist": "Spine",
    "{R}Eye": "{Right}Eye",
    "{R}Shoulder": "{Right}Arm",
    "{R}Elbow": "{Right}ForeArm",
    "{R}Wrist": "{Right}Hand",
    "{R}Fin": "{Right}HandMiddle4 {Right}HandMiddle3End {Right}HandIndex4 {Right}HandIndex3End "
    "{Right}HandIndex1End {Right}HandEnd",
    "{R}Knuckle": "{Right}HandMiddle1 {Right}HandIndex1 {Right}FingerBase {Right}HandFingerBase",
    "{R}Hip": "{Right}UpLeg",
    "{R}Knee": "{Right}Leg",
    "{R}Ankle": "{Right}Foot",
    "{R}Foot": "{Right}ToeEnd {Right}ToeBaseEnd {Right}FootEnd",
    "{R}ToeBase": "{Right}ToeBase",
}
_DAZ = {
    "Head": "HeadEnd",
    "Skull": "head",
    "{R}Eye": "{Right}Eye {R}Eye",
    "Neck": "neck neckLower",
    "Waist": "abdomen abdomenLower",
    "{R}Shoulder": "{R}Shldr {R}ShldrBend",
    "{R}Elbow": "{R}ForeArm {R}ForearmBend",
    "{R}Wrist": "{R}Hand",
    "{R}Fin": "{R}Mid3End {R}Mid2End {R}Index3End {R}Index2End {R}HandEnd",
    "{R}Knuckle": "{R}Mid1 {R}Index1",
    "{R}Hip": "{R}Thigh {R}ThighBend",
    "{R}Knee": "{R}Shin",
    "{R}Ankle": "{R}Foot",
    "{R}Foot": "{R}ToeEnd {R}FootEnd",
    "{R}ToeBase": "{R}Toe",
}
_BANDAI = {
    **_SPINE_BONES,
    "Waist": "Spine",
    "{R}Shoulder": "UpperArm{R}",
    "{R}Elbow": "LowerArm{R}",
    "{R}Wrist": "Hand{R}",
    "{R}Fin": "Hand{R}End",
    "{R}Hip": "UpperLeg{R}",
    "{R}Knee": "LowerLeg{R}",
    "{R}Ankle": "Foot{R}",
    "{R}Foot": "Toes{R}End",
    "{R}ToeBase": "Toes{R}",
}
_OPTITRACK_BONES = {
    **_SPINE_BONES,
    "Waist": "Ab Spine",
    "{R}Shoulder": "{R}UArm",
    "{R}Elbow": "{R}FArm",
    "{R}Wrist": "{R}Hand",
    "{R}Fin": "{R}HandEnd",
    "{R}Hip": "{R}Thigh",
    "{R}Knee": "{R}Shin",
    "{R}Ankle": "{R}Foot",
    "{R}Foot": "{R}ToeEnd",
    "{R}ToeBase": "{R}Toe",
}
_BIPED_BONES = {
    **_SPINE_BONES,
    "Waist": "Chest Spine",
    "{R}Shoulder": "{Right}Shoulder {Right}UpArm",
    "{R}Elbow": "{Right}Elbow {Right}LowArm",
    "{R}Wrist": "{Right}Wrist {Right}Hand",
    "{R}Fin": "{Right}WristEnd {Right}HandEnd",
    "{R}Hip": "{Right}Hip {Right}UpLeg",
    "{R}Knee": "{Right}Knee {Right}LowLeg",
    "{R}Ankle": "{Right}Ankle {Right}Foot",
    "{R}Foot": "{Right}ToeEnd {Right}AnkleEnd {Right}FootEnd",
    "{R}ToeBase": "{Right}Toe",
}
_SMPL = {
    "Skull": "Head",
    "Neck": "Neck",
    "Waist": "Spine1",
    "{R}Shoulder": "{R}Shoulder {Right}Shoulder",
    "{R}Elbow": "{R}Elbow {Right}Elbow",
    "{R}Wrist": "{R}Wrist {Right}Wrist",
    "{R}Knuckle": "{R}Hand {Right}Hand",
    "{R}Hip": "{R}Hip {Right}Hip",
    "{R}Knee": "{R}Knee {Right}Knee",
    "{R}Ankle": "{R}Ankle {Right}Ankle",
    "{R}ToeBase": "{R}Foot {Right}Foot {R}Toe",
}

_MAX_BIPED = {
    "Head": "HeadNub HeadEnd",
    "Skull": "Head",
    "Neck": "Neck",
    "Waist": "Spine",
    "{R}Shoulder": "{R}UpperArm",
    "{R}Elbow": "{R}Forearm",
    "{R}Wrist": "{R}Hand",
    "{R}Fin": "{R}Finger2Nub {R}Finger22End {R}Finger2End {R}Finger1Nub {R}Finger12End "
    "{R}Finger1End {R}HandEnd",
    "{R}Knuckle": "{R}Finger2 {R}Finger1",
    "{R}Hip": "{R}Thigh",
    "{R}Knee": "{R}Calf",
    "{R}Ankle": "{R}Foot",
    "{R}Foot": "{R}Toe0Nub {R}Toe0End {R}ToeBaseEnd {R}FootEnd",
    "{R}ToeBase": "{R}Toe0 {R}ToeBase",
}
_ROKOKO = {
    **_SPINE_BONES,
    "Head": "HeadTip HeadTopEnd HeadEnd",
    "Waist": "Spine1 Spine",
    "{R}Shoulder": "{Right}Arm",
    "{R}Elbow": "{Right}ForeArm",
    "{R}Wrist": "{Right}Hand",
    "{R}Fin": "{Right}Finger3Tip {Right}Finger3DistalEnd {Right}Finger2Tip "
    "{Right}Finger2DistalEnd {Right}HandEnd",
    "{R}Knuckle": "{Right}Finger3Proximal {Right}Finger2Proximal",
    "{R}Hip": "{Right}Thigh",
    "{R}Knee": "{Right}Shin",
    "{R}Ankle": "{Right}Foot",
    "{R}Foot": "{Right}ToeTip {Right}ToeEnd {Right}FootEnd",
    "{R}ToeBase": "{Right}Toe",
}
_UNREAL = {
    "Head": "HeadEnd",
    "Skull": "Head",
    "Neck": "Neck01 Neck",
    "Waist": "Spine01",
    "{R}Shoulder": "UpperArm{R}",
    "{R}Elbow": "LowerArm{R}",
    "{R}Wrist": "Hand{R}",
    "{R}Fin": "Middle03{R}End Index03{R}End Hand{R}End",
    "{R}Knuckle": "Middle01{R} Index01{R}",
    "{R}Hip": "Thigh{R}",
    "{R}Knee": "Calf{R}",
    "{R}Ankle": "Foot{R}",
    "{R}Foot": "Ball{R}End Foot{R}End",
    "{R}ToeBase": "Ball{R}",
}
_RIGIFY = {
    "Head": "Spine006End HeadEnd",
    "Skull": "Spine006 Head",
    "Neck": "Spine004 Neck",
    "Waist": "Spine001",
    "{R}Shoulder": "UpperArm{R}",
    "{R}Elbow": "Forearm{R}",
    "{R}Wrist": "Hand{R}",
    "{R}Fin": "FMiddle03{R}End FIndex03{R}End Hand{R}End",
    "{R}Knuckle": "FMiddle01{R} FIndex01{R}",
    "{R}Hip": "Thigh{R}",
    "{R}Knee": "Shin{R}",
    "{R}Ankle": "Foot{R}",
    "{R}Foot": "Toe{R}End Foot{R}End",
    "{R}ToeBase": "Toe{R}",
}

MARKER_SETS: tuple[MarkerSet, ...] = (
    _marker_set("shosa", _JOINT_NAMES),
    _marker_set(
        "Plug-in Gait",
        _PLUG_IN_GAIT,
        "{R}TIB {R}UPA {R}FRM {R}FRA RBAK {R}TIAP {R}TIAD {R}THAP {R}THAD PELO PELA TRXO HEDO",
    ),
    _marker_set("FiLMBOX", _FILMBOX, "{R}SHN {R}MT5 {R}UPA {R}FRM RBAC"),
    _marker_set(
        "OptiTrack markers",
        _OPTITRACK_MARKERS,
        "HeadFront HeadSide Back{Right} {R}ShoulderBack {R}UArmHigh {R}Shin",
    ),
    _marker_set("OpenSim", _OPENSIM, "{R}ASH {R}PSH {R}MT5 {R}TH1 {R}TB1 {R}UA1 {R}5meta"),
    _marker_set("OpenPose", _KEYPOINTS, "Nose CHip MidHip Hip {R}Eye {R}Ear {R}SmallToe"),
    _marker_set("DAZ", _DAZ, "hip chest {R}Collar {R}Buttock {R}Thumb1 {R}Index1 {R}Pinky1"),
    _marker_set(
        "CMU",
        _MIXAMO,
        "Hips {R}HipJoint LowerBack Spine1 Neck1 {Right}Shoulder {Right}FingerBase {R}Thumb",
    ),
    _marker_set(
        "MotionBuilder",
        _MIXAMO,
        "Hips Spine1 Spine2 Spine3 {Right}Shoulder {Right}HandThumb1 {Right}ForeArmRoll",
    ),
    _marker_set(
        "Mixamo", _MIXAMO, "Hips Spine1 Spine2 {Right}Shoulder {Right}HandThumb4 {Right}HandPinky4"
    ),
    _marker_set("Bandai", _BANDAI, "jointRoot Hips Chest Shoulder{R}"),
    _marker_set("OptiTrack bones", _OPTITRACK_BONES, "Hip Chest {R}Shoulder"),
    _marker_set("hip-knee-ankle bones", _BIPED_BONES, "Hips Chest2 {Right}Collar"),
    _marker_set("SMPL", _SMPL, "Pelvis Spine2 Spine3 {R}Collar"),
    _marker_set("3ds Max Biped", _MAX_BIPED, "Pelvis Spine1 Spine2 {R}Clavicle {R}Finger0"),
    _marker_set("Rokoko", _ROKOKO, "Hips Spine2 Spine3 Spine4 {Right}Shoulder"),
    _marker_set(
        "Unreal mannequin", _UNREAL, "Root Pelvis Spine02 Spine03 Clavicle{R} Thumb01{R} Ring01{R}"
    ),
    _marker_set(
        "Blender Rigify",
        _RIGIFY,
        "Spine Spine002 Spine003 Spine005 Shoulder{R} Pelvis{R} Palm01{R}",
    ),
)
"""Every marker set, in the order in which equals are preferred."""
