"""Which of the markers in a file make its joints: by a map, of one performer, if they are there."""

import unicodedata

import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.marker_choice import choose_points, nearest_names, place_joints
from tasks.motion.marker_sets import bare_name
from tests.tasks.motion.test_marker_sets import FRAMES, MARKERS, choose


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def test_a_map_may_leave_out_what_all_bones_begin_with():
    names = ("Model.P1", "Model.P2", "Model.P3")
    present = np.ones((FRAMES, 3), bool)
    for asked in ("Model.P2", "model.p2", "P2"):
        assert choose_points(names, present, [("RHip", (asked,))]).recipes == {"RHip": (1,)}


@pytest.mark.parametrize(
    ("one", "other"),
    [("左ひざ", "左膝"), ("колено", "таз"), ("की", "का"), ("★", "●"), ("膝1", "膝2"), ("か", "が")],
)
def test_names_without_latin_letters_are_not_all_the_same(one, other):
    assert bare_name(one) != bare_name(other)
    choice = choose_points((one, "Neck"), np.ones((FRAMES, 2), bool), [("RKnee", (other,))])
    assert "RKnee" not in choice.recipes
    assert f"the map gives RKnee = {other!r}, not in the file" in choice.faults[0]


@pytest.mark.parametrize("forms", [("NFC", "NFD"), ("NFD", "NFC"), ("NFD", "NFD")])
def test_names_are_the_same_composed_and_decomposed(forms):
    bone, asked = (unicodedata.normalize(form, "ガメラ1") for form in forms)
    choice = choose_points(("Neck", bone), np.ones((FRAMES, 2), bool), [("RKnee", (asked,))])
    assert choice.recipes["RKnee"] == (1,)


def test_the_nearest_of_kanji_names_share_a_letter():
    near = nearest_names("左膝", ("首", "左ひざ", "右ひざ", "左足首"))
    assert set(near) == {"左ひざ", "左足首"}


def test_the_order_of_markers_changes_nothing(rng):
    names = np.array(MARKERS["Plug-in Gait"].split())
    position = rng.normal(size=(FRAMES, len(names), 3))
    order = rng.permutation(len(names))
    there = place_joints(position, choose(tuple(names), position))
    mixed = position[:, order]
    np.testing.assert_array_equal(place_joints(mixed, choose(tuple(names[order]), mixed)), there)
    assert np.isfinite(there).all()


def test_modeled_joint_centers_come_before_markers_unless_they_are_mostly_missing():
    names = (*MARKERS["Plug-in Gait"].split(), "LHJC", "RHJC", "LFEO", "LKJC")
    present = np.ones((FRAMES, len(names)), bool)
    present[1:, names.index("LHJC")] = False
    present[1:, names.index("LKJC")] = False
    choice = choose_points(names, present)
    assert choice.recipes["RHip"] == (names.index("RHJC"),)
    assert "LHip" not in choice.recipes
    assert choice.recipes["LKnee"] == (names.index("LFEO"),)
    assert {"LHip", "RHip"} <= set(choice.joints)


def test_a_marker_that_is_seldom_there_is_taken_where_nothing_else_gives_the_joint():
    names = tuple(MARKERS["Plug-in Gait"].split())
    present = np.ones((FRAMES, len(names)), bool)
    present[1:, names.index("LELB")] = False
    assert "LElbow" in choose_points(names, present).joints
    present[:, names.index("LELB")] = False
    assert "LElbow" not in choose_points(names, present).joints


def test_of_two_performers_the_first_whole_one_is_taken_and_that_is_said():
    names = MARKERS["Plug-in Gait"].split()
    both = [f"mia:{name}" for name in names[:20]] + [f"ken:{name}" for name in names]
    both += [f"eva:{name}" for name in names]
    choice = choose_points(both, np.ones((FRAMES, len(both)), bool))
    assert {both[i][:4] for recipe in choice.recipes.values() for i in recipe} == {"ken:"}
    assert "Of the performers 'mia', 'ken', 'eva' in the file 'ken' was taken." in choice.notes


def test_a_map_comes_before_the_marker_set_and_its_markers_are_averaged(rng):
    names = (*MARKERS["FiLMBOX"].split(), "KneeIn")
    position = rng.normal(size=(FRAMES, len(names), 3))
    mapping = (("RKnee", ("RKNE", "kneein")),)
    choice = choose(names, position, mapping=mapping)
    assert choice.marker_set == "FiLMBOX and the given map"
    assert "By the given map: RKnee." in choice.notes
    middle = (position[:, names.index("RKNE")] + position[:, names.index("KneeIn")]) / 2
    np.testing.assert_array_equal(place_joints(position, choice)[:, JOINTS.index("RKnee")], middle)


def test_a_map_alone_makes_joints_of_names_that_no_set_knows():
    choice = choose_points(("p1", "p2"), np.ones((FRAMES, 2), bool), [("RHip", ("p2",))])
    assert (choice.marker_set, choice.joints) == ("the given map", ("RHip",))


def test_a_map_that_asks_for_what_is_not_there_says_so_with_the_nearest_names():
    names = ("RASI", "LASI", "dead")
    present = np.array([[True, True, False]] * FRAMES)
    mapping = (("RHip", ("RASY",)), ("LHip", ("LASI", "dead")))
    choice = choose_points(names, present, mapping)
    assert choice.faults == (
        "the map gives RHip = 'RASY', not in the file; near it: RASI",
        "the map gives LHip = 'dead', missing in every frame",
    )


def test_the_nearest_names_look_like_the_one_asked_for_in_any_case():
    assert nearest_names("rhip", ("LKnee", "RHip", "LHip")) == ["RHip", "LHip"]
    assert nearest_names("zzzz", ("LKnee", "RHip")) == []


def test_names_that_no_set_knows_give_no_joint():
    choice = choose_points(("Foot_Marker1", "", "*12"), np.ones((FRAMES, 3), bool))
    assert (choice.marker_set, choice.joints) == ("none", ())
    assert choose_points((), np.ones((FRAMES, 0), bool)).joints == ()
