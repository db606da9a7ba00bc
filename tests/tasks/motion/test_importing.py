"""A body that stands, right side; it looks to -z."""

import os
import unicodedata
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.motion.joint_map import read_joint_map
from storage.formats.motion.motion_file import MotionFile
from storage.schema import JOINTS
from tasks.motion.gaps import fill_gaps, filter_low_pass
from tasks.motion.importing import ImportSettings, make_joint_track
from tests.figures.motion_files import (
    FRAMES,
    GIVEN,
    PLUG_IN_GAIT,
    RATE_HZ,
    dance,
    motion_file,
    said,
    track_of,
)


def test_our_own_joints_come_through_as_they_are():
    motion = motion_file()
    track = track_of(motion)
    order = [motion.names.index(joint) for joint in JOINTS]
    np.testing.assert_allclose(track.position, motion.position[:, order], atol=1e-6)
    assert track.position.dtype == np.float32
    assert track.position.shape == (FRAMES, 21, 3)
    assert not track.filled.any()
    assert (track.marker_set, track.rate_hz) == ("shosa", RATE_HZ)


@pytest.mark.parametrize("gap", [11, 12])
def test_a_gap_of_a_fifth_of_a_second_is_filled_and_flagged(gap):
    motion = motion_file(PLUG_IN_GAIT)
    torn = motion.position.copy()
    torn[40 : 40 + gap, motion.names.index("RKNE")] = np.nan
    track, whole = track_of(replace(motion, position=torn)), track_of(motion)
    touched = [JOINTS.index(joint) for joint in ("RKnee", "RAnkle")]
    assert track.filled[40 : 40 + gap, touched].all()
    assert track.filled.sum() == gap * len(touched)
    np.testing.assert_allclose(track.position, whole.position, atol=2e-4)
    assert said(track, f"filled by a cubic spline: {gap} frames of RKNE.")


def test_a_longer_gap_and_the_ends_stay_missing():
    motion = motion_file(PLUG_IN_GAIT)
    torn = motion.position.copy()
    knee = motion.names.index("RKNE")
    torn[40:53, knee] = torn[:15, knee] = torn[-3:, knee] = np.nan
    track = track_of(replace(motion, position=torn))
    lost = np.isnan(track.position[:, JOINTS.index("RKnee"), 0])
    np.testing.assert_array_equal(np.flatnonzero(lost), [*range(15), *range(40, 53), 117, 118, 119])
    assert not track.filled.any()
    assert said(track, "the longest inside 13 frames): RKNE 31.")


def test_infinite_positions_are_missing():
    motion = motion_file()
    wild = motion.position.copy()
    wild[50, motion.names.index("RHip")] = [np.inf, 0, 0]
    track = track_of(replace(motion, position=wild))
    assert track.filled[50, JOINTS.index("RHip")]
    np.testing.assert_allclose(track.position, track_of(motion).position, atol=1e-4)


def test_moving_and_turning_the_markers_moves_and_turns_the_joints():
    motion = motion_file(PLUG_IN_GAIT)
    turn, shift = Rotation.from_euler("y", 130, degrees=True), np.array([3, 0, -2])
    moved = turn.apply(motion.position.reshape(-1, 3)).reshape(motion.position.shape) + shift
    track, here = track_of(replace(motion, position=moved)), track_of(motion)
    expected = turn.apply(here.position.reshape(-1, 3)).reshape(here.position.shape) + shift
    np.testing.assert_allclose(track.position, expected, atol=1e-5)
    assert track.stature_m == pytest.approx(here.stature_m, abs=1e-6)


def test_markers_of_plug_in_gait_make_a_body_of_human_measures():
    track = track_of(motion_file(PLUG_IN_GAIT))
    at = {joint: track.position[0, i].astype(float) for i, joint in enumerate(JOINTS)}
    assert np.isfinite(track.position).all()
    assert 0.1 < np.linalg.norm(at["RHip"] - at["LHip"]) < 0.25
    assert 1.4 < track.stature_m < 1.7
    assert at["RFoot"][2] < at["RHeel"][2] - 0.2
    assert at["Neck"][1] < at["Head"][1]
    for name in ("Knee", "Ankle", "Elbow"):
        assert at["L" + name][0] < at["R" + name][0]
    assert said(track, "Placed by rule, RHip and LHip: from the ASIS and PSIS markers")


def test_stature_is_measured_unless_it_is_given():
    track = track_of(motion_file(frames=1))
    leg = np.linalg.norm([0.01, 0.43, 0.05]) + np.linalg.norm([0.01, 0.44, 0.05])
    assert track.stature_m == pytest.approx(0.25 + 0.45 + leg, abs=0.01)
    assert track.stature_source == "measured"
    given = track_of(motion_file(), stature_m=1.72)
    assert (given.stature_m, given.stature_source) == (1.72, "given")


def test_end_sites_of_no_length_are_not_there():
    names, position = dance({**GIVEN, "ROut": GIVEN["RFoot"]})
    bones = {"RFin": "RightHand End", "RWrist": "RightHand", "RFoot": "RightToeBase"}
    bones |= {"ROut": "RightToeBase End", "RHip": "RightUpLeg", "RKnee": "RightLeg"}
    bones |= {"RAnkle": "RightFoot", "Head": "Head End"}
    bones |= {"L" + a[1:]: b.replace("Right", "Left") for a, b in bones.items() if a[0] == "R"}
    motion = MotionFile("bvh", tuple(bones.get(n, n) for n in names), position, RATE_HZ, 1.0, "y")
    track = track_of(motion)
    assert said(track, "Placed by rule, RFoot and LFoot: the toe base itself.")
    motion.position[:, motion.names.index("RightToeBase End"), 1] -= 0.01
    assert said(track_of(motion), "Placed by rule, LFoot: the toe base itself.")


def test_low_pass_removes_noise_and_shifts_nothing(rng):
    motion = motion_file()
    noisy = motion.position + 0.003 * rng.normal(size=motion.position.shape)
    track = track_of(replace(motion, position=noisy), low_pass_hz=6.0)
    plain = track_of(replace(motion, position=noisy))
    truth = track_of(motion).position
    inside = slice(15, -15)
    error = np.sqrt(np.mean((track.position - truth)[inside] ** 2))
    assert error < 0.6 * np.sqrt(np.mean((plain.position - truth)[inside] ** 2))
    assert said(track, "Movement above 6 Hz was filtered out.")


def test_low_pass_halves_the_power_at_its_frequency_and_keeps_gaps_and_short_runs():
    time = np.arange(600) / 100
    wave = np.sin(2 * np.pi * 8.0 * time)
    track = np.repeat(wave[:, None, None], 3, axis=2)
    smooth = filter_low_pass(track, 100.0, 8.0)
    share = np.abs(np.fft.rfft(smooth[100:500, 0, 0])).max()
    share /= np.abs(np.fft.rfft(track[100:500, 0, 0])).max()
    assert share**2 == pytest.approx(0.5, abs=0.002)
    track[300] = track[309] = np.nan
    torn = filter_low_pass(track, 100.0, 8.0)
    np.testing.assert_array_equal(np.isnan(torn), np.isnan(track))
    np.testing.assert_array_equal(torn[301:309], track[301:309])
    with pytest.raises(ValueError, match=r"low_pass_hz is 50; at 100 .* above 0 and below 50"):
        filter_low_pass(track, 100.0, 50.0)


def test_a_gap_in_a_cubic_is_filled_with_the_cubic():
    time = np.arange(30.0)[:, None, None] / 10
    truth = np.concatenate([time**3 - 2 * time, 1 - time**2, 0 * time + 5], axis=2)
    torn = truth.copy()
    torn[9:14] = torn[20] = torn[:2] = torn[28:] = np.nan
    filled = fill_gaps(torn, 5)
    np.testing.assert_allclose(filled[2:28], truth[2:28], atol=1e-12)
    assert np.isnan(filled[[0, 1, 28, 29]]).all()
    assert np.isnan(fill_gaps(torn, 4)[9:14]).all()
    np.testing.assert_allclose(fill_gaps(torn, 4)[20], truth[20], atol=1e-12)


def test_a_marker_seen_once_fills_nothing():
    torn = np.full((9, 2, 3), np.nan)
    torn[4] = 1.0
    np.testing.assert_array_equal(fill_gaps(torn, 3), torn)


def test_a_file_without_hips_and_joints_is_refused_with_all_reasons_and_its_names():
    names = ("Foot_Marker1", "Foot_Marker2", "Knee_Marker1")
    motion = MotionFile("c3d", names, np.zeros((4, 3, 3)), RATE_HZ, 0.001, "z")
    with pytest.raises(InputError) as caught:
        track_of(motion, low_pass_hz=40.0)
    for part in (
        "okuri48.trc cannot be imported: a low-pass at 40 Hz is asked for",
        "at 60 frames a second it must be below 30 Hz",
        "it has no RHip and no LHip, and the hips are the frame of the body",
        "it has 0 joints where at least 6 are wanted",
        "no marker set makes a joint of its names",
        "its names are Foot_Marker1, Foot_Marker2, Knee_Marker1: say with --map",
    ):
        assert part in str(caught.value)


def test_a_file_with_one_hip_names_the_nearest_marker_set():
    motion = motion_file({name: at for name, at in GIVEN.items() if name[0] == "R"})
    names = tuple("other" if name == "LHip" else name for name in motion.names)
    with pytest.raises(
        InputError, match=r"has no LHip, .*nearest marker set is shosa, which gives Neck, R"
    ):
        track_of(replace(motion, names=names))


def test_a_hip_that_is_never_there_counts_as_missing():
    motion = motion_file()
    motion.position[:, motion.names.index("RHip")] = np.nan
    with pytest.raises(InputError, match="it has no RHip, and"):
        track_of(motion)


def test_a_file_without_frames_is_refused():
    motion = motion_file()
    with pytest.raises(InputError, match="it has no RHip and no LHip"):
        track_of(replace(motion, position=motion.position[:0]))


def test_long_lists_of_names_are_cut():
    names = tuple(f"p{i}" for i in range(80))
    motion = MotionFile("c3d", names, np.zeros((2, 80, 3)), RATE_HZ, None, None)
    with pytest.raises(InputError, match="p59 and 20 more: say with --map"):
        track_of(motion)


def test_a_map_that_does_not_fit_is_said_beside_the_rest():
    with pytest.raises(InputError, match="the map gives RHip = 'RHipp', not in the file; near it"):
        track_of(motion_file(), mapping=(("RHip", ("RHipp",)),))


def test_settings_that_make_no_sense_are_all_said():
    settings = ImportSettings(longest_gap_s=-1, scale=0.0, low_pass_hz=np.nan, up="up")
    with pytest.raises(
        ValueError,
        match=r"longest_gap_s is -1.*low_pass_hz is nan.*scale is 0\.0.*up is 'up', wanted is one",
    ):
        make_joint_track(motion_file(), settings, file_name="okuri48.trc")


def test_a_joint_map_is_read_line_by_line(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text('RHip = "RH"\nLHip = ["LASI", "LPSI"]\n')
    assert read_joint_map(path) == (("RHip", ("RH",)), ("LHip", ("LASI", "LPSI")))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('RHipp = "RH"\nHead = 3', "'RHipp' is no joint; RHip.* is; Head = 3 is neither a marker"),
        ("RHip = []", r"RHip = \[\] is neither a marker's name nor a list of names"),
        ('RHip = ["A", "A"]', "names a marker twice"),
        ("", "is empty; bring a TOML file with a line a joint"),
        ("# nothing", "no joint is named"),
        ("RHip = ", "is not TOML"),
        ('xyzzy = "A"', "'xyzzy' is no joint; Head, Neck, .* or LFoot is"),
    ],
)
def test_a_joint_map_that_cannot_be_used_says_why(tmp_path, text, match):
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=match):
        read_joint_map(path)


def test_a_joint_map_may_bear_a_mark_and_decomposed_names(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(f'RHip = "{unicodedata.normalize("NFD", "ガメラ")}"\n', encoding="utf-8-sig")
    assert read_joint_map(path) == (("RHip", ("ガメラ",)),)
    path.write_text('RHip = "左膝"\n', encoding="cp932")
    with pytest.raises(InputError, match="not in UTF-8 but looks like cp932"):
        read_joint_map(path)


def test_a_joint_map_that_is_not_there_says_so(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_joint_map(tmp_path / "none.toml")


DATA = Path(os.environ.get("SHOSA_DATA", Path(__file__).parents[3] / "../shared/data"))


needs_data = [
    pytest.mark.data,
    pytest.mark.skipif(not DATA.is_dir(), reason="the shared recordings are not here"),
]


def shared_track(name):
    motion = read_motion_file(DATA / name)
    return make_joint_track(motion, file_name=Path(name).name)


def bone(track, a, b):
    between = track.position[:, JOINTS.index(a)] - track.position[:, JOINTS.index(b)]
    return np.linalg.norm(between.astype(float), axis=1)


class TestSharedRecordings:
    pytestmark = needs_data

    @pytest.mark.parametrize("name", ["indian/indian_13", "salsa/salsa_20", "martial/martial_04"])
    def test_dancers_of_the_cmu_have_bones_of_constant_human_length(self, name):
        track = shared_track(f"mocap/{name}.bvh")
        assert track.marker_set == "DAZ"
        assert said(track, "The unit was taken to be centimeters")
        assert 1.5 < track.stature_m < 1.85
        for a, b in (
            ("RHip", "LHip"),
            ("RHip", "RKnee"),
            ("LKnee", "LAnkle"),
            ("RElbow", "RWrist"),
        ):
            assert np.ptp(bone(track, a, b)) < 1e-5
        assert 0.1 < bone(track, "RHip", "LHip")[0] < 0.25
        assert 0.2 < np.median(bone(track, "Head", "Neck")) < 0.3
        feet = track.position[:, [JOINTS.index("RFoot"), JOINTS.index("LFoot")], 1].min(axis=1)
        assert abs(np.percentile(feet, 1)) < 0.051

    def test_a_ballet_of_41_markers_becomes_a_body(self):
        track = shared_track("trc/ballet_reduced.trc")
        assert track.marker_set == "FiLMBOX"
        assert np.isfinite(track.position).all()
        assert np.ptp(bone(track, "RHip", "LHip")) < 0.001
        assert 0.15 < np.median(bone(track, "RHip", "LHip")) < 0.22
        assert np.ptp(bone(track, "RHip", "RKnee")) < 0.05
        assert 1.5 < track.stature_m < 1.85

    def test_hips_by_regression_are_near_those_that_the_laboratory_modeled(self):
        motion = read_motion_file(DATA / "c3d/PiG_Motion-FlatFoot-Full.c3d")
        modeled = shared_track("c3d/PiG_Motion-FlatFoot-Full.c3d")
        segments = {s + b for s in "RL" for b in ("FE", "TI", "CL", "HU", "RA")}
        keep = [i for i, name in enumerate(motion.names) if name[:3] not in segments]
        bare = replace(
            motion,
            names=tuple(motion.names[i] for i in keep),
            position=motion.position[:, keep],
        )
        measured = make_joint_track(bare, file_name="bare")
        assert said(measured, "Harrington")
        assert not said(modeled, "Harrington")
        limits = {"Hip": 0.03, "Knee": 0.03, "Ankle": 0.03, "Shoulder": 0.04, "Wrist": 0.03}
        for name, limit_m in limits.items():
            for side in "RL":
                k = JOINTS.index(side + name)
                apart = np.linalg.norm(measured.position[:, k] - modeled.position[:, k], axis=1)
                assert np.nanmedian(apart) < limit_m, side + name

    def test_a_map_to_a_bone_that_is_not_there_is_refused_with_the_nearest(self):
        folder = DATA / "reports/R04"
        motion = read_motion_file(folder / "mmd_utf-8.bvh")
        settings = ImportSettings(mapping=read_joint_map(folder / "mmd_typo.toml"))
        with pytest.raises(
            InputError, match=r"LKnee = '左膝', not in the file; near it: .*左ひざ.*RKnee = '右膝'"
        ):
            make_joint_track(motion, settings, file_name="mmd")
        settings = ImportSettings(mapping=read_joint_map(folder / "mmd.toml"))
        track = make_joint_track(motion, settings, file_name="mmd")
        knee = track.position[:, JOINTS.index("LKnee")]
        place = motion.position[:, motion.names.index("左ひざ")] * 0.01
        np.testing.assert_allclose(knee, place, atol=1e-5)

    @pytest.mark.parametrize(("name", "marker_set"), [("dots", "CMU"), ("biped", "3ds Max Biped")])
    def test_bones_with_a_shared_prefix_make_a_body(self, name, marker_set):
        track = shared_track(f"reports/R16/{name}.bvh")
        assert track.marker_set == marker_set
        assert track.stature_m == pytest.approx(1.546, abs=0.01)
        assert said(track, "Missing joints: RHeel, LHeel.")

    @pytest.mark.parametrize("name", ["Eb015pi", "Eb015pr", "pc_real", "walkingOptiTrack"])
    def test_files_of_clusters_alone_are_refused_with_their_names(self, name):
        motion = read_motion_file(DATA / f"c3d/{name}.c3d")
        with pytest.raises(InputError, match=rf"no RHip and no LHip.*{motion.names[0]}"):
            make_joint_track(motion, file_name=name)


@pytest.fixture
def rng():
    return np.random.default_rng(5)
