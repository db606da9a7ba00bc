import json

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.capture.initial import OPTIONAL, read_initial, write_initial
from storage.schema import JOINTS

SIDES = {
    "Shoulder": (0.16, 1.36, 0.0),
    "Elbow": (0.44, 1.36, 0.01),
    "Wrist": (0.68, 1.36, 0.02),
    "Fin": (0.85, 1.36, 0.03),
    "Hip": (0.09, 0.88, 0.02),
    "Knee": (0.10, 0.47, 0.05),
    "Ankle": (0.11, 0.07, 0.0),
    "Heel": (0.11, 0.02, -0.05),
    "Foot": (0.13, 0.02, 0.19),
}


def stretched():
    """Return a body that faces +z: its left is at +x."""
    place = {"Head": (0.0, 1.7, 0.02), "Neck": (0.0, 1.42, 0.0), "Waist": (0.0, 1.05, 0.0)}
    for name, (x, y, z) in SIDES.items():
        place |= {f"L{name}": (x, y, z), f"R{name}": (-x, y, z)}
    return np.array([place[name] for name in JOINTS])


def write(path, **changes):
    """Write an initial.json with changes; a joint that is None is left out."""
    joints = {n: p.tolist() for n, p in zip(JOINTS, stretched(), strict=True)}
    joints |= changes.pop("joints", {})
    joints = {name: place for name, place in joints.items() if place is not None}
    path.write_text(json.dumps({"joints": joints, **changes}))
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "initial.json"


def test_what_is_written_is_read_again(path):
    position = stretched()
    label = np.repeat([0, 3, 1, 0, 11, 3], [5, 4, 1, 2, 300, 1])
    write_initial(path, position, frame=17, label=label)
    again = read_initial(path)
    np.testing.assert_allclose(again.position, position, atol=5e-5)
    assert again.frame == 17
    np.testing.assert_array_equal(again.label, label)
    assert again.label.dtype == np.uint8
    assert [3, 4] in json.loads(path.read_text())["labels"]


def test_frame_labels_and_hidden_joints_may_be_left_out(path):
    position = stretched()
    position[[JOINTS.index(name) for name in OPTIONAL]] = np.nan
    write_initial(path, position)
    again = read_initial(path)
    np.testing.assert_allclose(again.position, position, atol=5e-5)
    assert again.frame is None
    assert again.label is None


def test_a_body_that_faces_anywhere_is_read(path):
    for angle in np.linspace(0.1, 6.1, 7):
        turn = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        write_initial(path, stretched() @ turn.T + [3.0, 0.0, -2.0])
        assert np.isfinite(read_initial(path).position).all()


def test_every_fault_of_names_and_numbers_is_said_at_once(path):
    joints = {"RKnee": None, "Head": [0, "1", 2], "Neck": [0, 1], "Nose": [0, 1, 2]}
    write(path, joints=joints, frame=-1, labels=[[12, 4]], extra=1)
    with pytest.raises(InputError) as error:
        read_initial(path)
    for part in (
        "'extra' is not known",
        "'Nose' is no joint",
        "'Head', 'Neck' must be three finite numbers",
        "'RKnee' is missing; place it",
        "frame -1 must be a whole number from 0",
        "labels must be a list of [segment 0 to 11",
    ):
        assert part in str(error.value)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e400", "true", "null"])
def test_what_is_no_number_is_refused(path, number):
    write(path)
    path.write_text(path.read_text().replace("[0.0, 1.7, 0.02]", f"[0.0, {number}, 0.02]"))
    with pytest.raises(InputError, match="'Head' must be three finite numbers"):
        read_initial(path)


def exchanged(*names):
    place = dict(zip(JOINTS, stretched().tolist(), strict=True))
    return {a + name: place[b + name] for name in names for a, b in ("RL", "LR")}


def test_swapped_sides_are_said(path):
    write(path, joints=exchanged(*SIDES))
    with pytest.raises(InputError, match="toes point backward: right and left are swapped"):
        read_initial(path)
    for hidden in (("Heel",), ("Heel", "Ankle")):
        gone = {side + name: None for side in "RL" for name in hidden}
        write(path, joints={**exchanged(*SIDES), **gone})
        with pytest.raises(InputError, match="toes point backward"):
            read_initial(path)
    write(path, joints=exchanged("Shoulder", "Elbow", "Wrist", "Fin"))
    with pytest.raises(InputError, match="exchanged between hips and shoulders"):
        read_initial(path)
    write(path, joints=exchanged("Elbow"))
    with pytest.raises(InputError, match="RElbow and LElbow are swapped"):
        read_initial(path)
    write(path, joints=exchanged("Knee"))
    with pytest.raises(InputError, match="RKnee and LKnee are swapped"):
        read_initial(path)
    write(path, joints=exchanged("Wrist", "Fin"))
    with pytest.raises(InputError, match=r"RWrist and LWrist are swapped.*RFin and LFin are"):
        read_initial(path)


def test_a_joint_on_another_limb_is_said(path):
    write(path, joints={"LFin": [0.12, 0.03, 0.15]})
    with pytest.raises(
        InputError, match=r"LElbow to LFin is 1\.3\d m, too long for a body of 1\.7"
    ):
        read_initial(path)


def test_a_body_in_any_pose_is_read(path):
    place = dict(zip(JOINTS, stretched(), strict=True))
    for side, other in ("RL", "LR"):  # hands crossed before the chest, squatting with crossed feet
        place[f"{side}Elbow"] = place[f"{side}Shoulder"] + [0.0, -0.2, 0.2]
        place[f"{side}Fin"] = place[f"{other}Shoulder"] + [0.0, -0.2, 0.25]
        place[f"{side}Wrist"] = (place[f"{side}Elbow"] + 2 * place[f"{side}Fin"]) / 3
        place[f"{side}Knee"] = place[f"{side}Hip"] + [0.0, 0.05, 0.42]
        place[f"{side}Ankle"] = place[f"{other}Hip"] + [0.0, -0.35, 0.2]
        place[f"{side}Heel"] = place[f"{side}Ankle"] + [0.0, -0.05, -0.05]
        place[f"{side}Foot"] = place[f"{side}Ankle"] + [0.0, -0.05, 0.18]
    write_initial(path, np.array([place[name] for name in JOINTS]))
    assert np.isfinite(read_initial(path).position).all()


def test_other_units_and_axes_are_said(path):
    write(path, joints=dict(zip(JOINTS, (stretched() * 1000).tolist(), strict=True)))
    with pytest.raises(InputError, match=r"body is 1.*e\+03 m .*; give metres"):
        read_initial(path)
    write(path, joints=dict(zip(JOINTS, (stretched() * [1, -1, 1]).tolist(), strict=True)))
    with pytest.raises(InputError, match="the head is below the hips; y must point up"):
        read_initial(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; bring a JSON file"),
        ("{", r"is not JSON \("),
        ("[" * 100_000, "is not JSON"),
        ("[1, 2]", "has no table `joints`"),
        ('{"joints": []}', "has no table `joints`"),
        ('{"joints": {}}', "'Head', 'Neck', 'RShoulder'.* is missing"),
    ],
    ids=["empty", "cut", "deep", "list", "no table", "nothing placed"],
)
def test_what_is_no_initial_file_is_refused(path, text, message):
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_initial(path)


def test_a_few_bytes_do_not_ask_for_much_memory(path):
    write(path, labels=[[1, 4_000_000_000]])
    with pytest.raises(InputError, match="labels must be a list"):
        read_initial(path)


def test_what_cannot_be_written_is_refused(path):
    with pytest.raises(ValueError, match=r"position is \(20, 3\)"):
        write_initial(path, stretched()[1:])
    lost = stretched()
    lost[JOINTS.index("LKnee")] = np.nan
    with pytest.raises(ValueError, match="'LKnee' must be finite"):
        write_initial(path, lost)
    with pytest.raises(ValueError, match="numbers from 0 to 11"):
        write_initial(path, stretched(), label=np.array([3, 12]))
    assert not path.exists()
