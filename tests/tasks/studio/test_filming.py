import tomllib

import cv2
import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.calibration.camera import Camera
from storage.formats.capture.capture import read_capture
from storage.schema import JOINTS
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, generate_performance
from tasks.studio.stage.bodies import CHECKS, pose_surface
from tasks.studio.stage.rasterization import draw_triangles, lay_over, project_bent
from tasks.studio.stage.scenes import Spoilers, light_scene

ENDS = ("Head", "RFin", "LFin", "RHeel", "LHeel", "RFoot", "LFoot")
SMALL = RingSettings(cameras=3, overhead=1, size=(88, 64), distortion=(-0.12, 0.02), radius_m=3.5)
CLEAN = Spoilers(noise=0.0, flicker=0.0, drift=0.0, shadow=0.0)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture(scope="module")
def track():
    danced = generate_performance([okuri48()], TK, rate_hz=10.0).position
    return stretch_arms_first(danced, 10.0, still_s=0.2, blend_s=0.3)[[0, 9]]


@pytest.fixture(scope="module")
def cameras():
    return generate_cameras(SMALL, center_m=(0.0, 0.9, 0.0), seed=4)


def film(folder, track, cameras, **settings):
    settings = {"compressed": False, **settings}
    return film_capture(folder, track, 10.0, cameras=cameras, settings=FilmSettings(**settings))


def read(folder, camera, frame):
    return cv2.imread(str(folder / "videos" / camera / f"{frame:06d}.png"))[..., ::-1]


def projected(camera, points):
    rotation = cv2.Rodrigues(camera.rotation)[0]
    points = np.asarray(points, np.float64).reshape(-1, 1, 3)
    image = cv2.projectPoints(
        points, rotation, camera.translation, camera.intrinsics, camera.distortion
    )
    return image[0][:, 0]


@pytest.mark.parametrize("clothes", ["fitting", "kimono"])
def test_true_silhouettes_are_the_polygons_of_the_surface(tmp_path, track, cameras, clothes):
    truth = film(tmp_path / "take", track, cameras, clothes=clothes)
    surface = pose_surface(
        dict(zip(JOINTS, np.moveaxis(track, 1, 0), strict=True)), clothes=clothes
    )
    fine = 15
    for number, camera in enumerate(cameras):
        columns, rows = camera.size
        for frame in range(len(track)):
            corners = projected(camera, surface.vertex[frame])[surface.triangle]
            drawn = np.zeros((fine * rows, fine * columns), np.uint8)
            for corner in np.rint(16 * (fine * corners + fine // 2)).astype(np.int32):
                cv2.fillConvexPoly(drawn, corner, 1, lineType=cv2.LINE_8, shift=4)
            shrunk = cv2.erode(drawn, np.ones((5, 5)))  # OpenCV also draws the outline
            drawn, shrunk = (
                mask[fine // 2 :: fine, fine // 2 :: fine] > 0 for mask in (drawn, shrunk)
            )
            filmed = truth.silhouette[frame, number]
            assert filmed.sum() > 80
            assert not (filmed & ~drawn).any()
            assert not (shrunk & ~filmed).any()
            assert shrunk.sum() > 0.85 * filmed.sum()


def test_joints_are_filmed_inside_the_silhouette(tmp_path, track, cameras):
    truth = film(tmp_path / "take", track, cameras)
    inner = [joint for joint, name in enumerate(JOINTS) if name not in ENDS]
    for number, camera in enumerate(cameras):
        for frame, position in enumerate(track):
            column, row = np.rint(projected(camera, position[inner])).astype(int).T
            assert truth.silhouette[frame, number, row, column].all()


def test_the_same_seed_films_the_same_bytes_and_another_does_not(tmp_path, track, cameras):
    def files(name, seed):
        settings = FilmSettings(compressed=False)
        film_capture(
            tmp_path / name, track, 10.0, cameras=cameras[:2], settings=settings, seed=seed
        )
        names = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        return {str(path.relative_to(tmp_path / name)): path.read_bytes() for path in names}

    first, again, other = files("first", 1), files("again", 1), files("other", 2)
    assert len(first) == 2 + 2 + 4
    assert first == again
    assert all(first[name] != other[name] for name in first if name.endswith(".png"))


def test_drawing_agrees_with_its_naive_twin(rng):
    rows, columns, samples = 7, 11, 3
    pixel = rng.uniform(-4.0, 13.0, (23, 2)).astype(np.float32)
    depth = rng.uniform(0.5, 4.0, 23).astype(np.float32)
    depth[5] = 0.0
    triangle = rng.permuted(np.tile(np.arange(23), (19, 1)), axis=1)[:, :3].astype(np.int32)
    color = rng.uniform(0.0, 255.0, (19, 3)).astype(np.float32)
    expected = np.full((rows * samples, columns * samples), -1)
    for row in range(rows * samples):
        for column in range(columns * samples):
            at = [(column + 0.5) / samples - 0.5, (row + 0.5) / samples - 0.5, 1.0]
            best = 0.0
            for number, corner in enumerate(triangle):
                if (depth[corner] == 0).any():
                    continue
                matrix = np.vstack([pixel[corner].T.astype(float), np.ones(3)])
                weights = np.linalg.solve(matrix, at)
                near = weights @ (1.0 / depth[corner])
                if weights.min() >= 0.0 and near > best:
                    best, expected[row, column] = near, number
    seen = np.full(expected.shape, -1, np.int32)
    draw_triangles(pixel, depth, triangle, np.zeros(seen.shape, np.float32), seen, samples=samples)
    np.testing.assert_array_equal(seen, expected)
    assert len(np.unique(seen)) > 8
    image = np.full((rows, columns, 3), 40.0, np.float32)
    every = np.where(expected[..., None] >= 0, color[expected], 40.0)
    mean = every.reshape(rows, samples, columns, samples, 3).mean(axis=(1, 3))
    lay_over(image, seen, color, samples=samples)
    np.testing.assert_allclose(image, mean, rtol=1e-5)


def test_projection_is_that_of_opencv_with_every_coefficient(rng, cameras):
    camera = cameras[1]
    bent = np.array([-0.1, 0.02, 0.003, -0.004, 0.001])
    points = rng.uniform([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0], (13, 3))
    pose = np.column_stack([camera.rotation, camera.translation])
    pixel, depth = project_bent(points, pose, camera.intrinsics, bent)
    rotation = cv2.Rodrigues(camera.rotation)[0]
    expected, _ = cv2.projectPoints(points, rotation, camera.translation, camera.intrinsics, bent)
    np.testing.assert_allclose(pixel, expected[:, 0], atol=1e-4)
    np.testing.assert_allclose(depth, pose[2] @ np.vstack([points.T, np.ones(13)]), rtol=1e-6)


def test_what_a_lens_folds_back_or_is_behind_it_is_not_seen():
    pose, inner = np.eye(3, 4), np.diag([30.0, 30.0, 1.0])
    points = np.array([[0.1, 0.0, 1.0], [1.9, 0.0, 1.0], [0.1, 0.0, -1.0]])
    _, depth = project_bent(points, pose, inner, np.array([-0.1, 0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(depth, [1.0, 0.0, 0.0])


def test_cameras_stand_upright_around_what_they_look_at(cameras):
    assert [camera.name for camera in cameras] == ["cam1", "cam2", "cam3", "cam4"]
    for number, camera in enumerate(cameras):
        middle, higher = projected(camera, [[0.0, 0.9, 0.0], [0.0, 1.4, 0.0]])
        np.testing.assert_allclose(middle, [43.5, 31.5], atol=1.6)
        place = camera.center_m
        if number < 3:
            assert higher[1] < middle[1] - 5.0
            assert 3.3 < np.hypot(place[0], place[2]) < 3.7
        else:
            assert np.hypot(place[0], place[2]) < 0.01
            assert place[1] > 4.3
    bearings = [np.arctan2(*camera.center_m[[0, 2]]) for camera in cameras[:3]]
    np.testing.assert_allclose(np.sin(1.5 * np.diff(bearings)) ** 2, 0.0, atol=1e-6)


def test_the_opening_stretches_the_arms_and_ends_in_the_given_track():
    danced = generate_performance([okuri48()], TK, rate_hz=10.0, heading=1.3).position
    whole = stretch_arms_first(danced, 10.0, still_s=1.0, blend_s=0.8)
    assert len(whole) == len(danced) + 18
    np.testing.assert_array_equal(whole[18:], danced)
    left = whole[0, JOINTS.index("LFin")] - whole[0, JOINTS.index("LShoulder")]
    right = whole[9, JOINTS.index("RFin")] - whole[9, JOINTS.index("RShoulder")]
    np.testing.assert_allclose(right / np.linalg.norm(right), -left / np.linalg.norm(left))
    assert abs(left[1]) < 1e-9
    for side in "RL":
        for a, b in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Fin")):
            bone = whole[:19, JOINTS.index(side + b)] - whole[:19, JOINTS.index(side + a)]
            lengths = np.linalg.norm(bone, axis=-1)
            np.testing.assert_allclose(lengths, lengths[-1], rtol=1e-9)
    moved = np.linalg.norm(np.diff(whole, axis=0), axis=-1).max(axis=1)
    assert moved[:9].max() == 0.0
    assert 0.05 < moved.max() < 0.35


def test_a_segment_is_filmed_in_its_own_colors(tmp_path, track, cameras):
    film(tmp_path / "take", track[:1], cameras, spoilers=CLEAN)
    bones = {"Body": ("Waist", "Neck"), "RLowerLeg": ("RKnee", "RAnkle")}
    for name, ends in bones.items():
        middle = track[0, [JOINTS.index(joint) for joint in ends]].mean(axis=0)
        colors = np.array(CHECKS[name], float)
        colors /= np.linalg.norm(colors, axis=1, keepdims=True)
        alike = []
        for camera in cameras[:3]:
            column, row = np.rint(projected(camera, middle)[0]).astype(int)
            pixel = read(tmp_path / "take", camera.name, 0)[row, column].astype(float)
            alike.append((colors @ pixel).max() / np.linalg.norm(pixel))
        assert sorted(alike)[1] > 0.985, name  # the other leg may stand before this one


def test_noise_gain_and_shadow_are_as_asked(tmp_path, track, cameras):
    stage, shaded = Spoilers(noise=3.0, flicker=0.0, drift=0.0, shadow=0.0), 0.5
    truth = film(tmp_path / "noisy", track, cameras[:1], spoilers=stage)
    film(tmp_path / "clean", track, cameras[:1], spoilers=CLEAN)
    dark = Spoilers(noise=0.0, flicker=0.0, drift=0.0, shadow=shaded)
    film(tmp_path / "dark", track, cameras[:1], spoilers=dark)
    drifting = Spoilers(noise=0.0, flicker=0.05, drift=0.0, shadow=0.0)
    film(tmp_path / "drifting", track, cameras[:1], spoilers=drifting)
    away = ~cv2.dilate(truth.silhouette[1, 0].astype(np.uint8), np.ones((3, 3))).astype(bool)
    noisy, clean, dark, drifting = (
        read(tmp_path / name, "cam1", 1)[away].astype(float)
        for name in ("noisy", "clean", "dark", "drifting")
    )
    empty = cv2.imread(str(tmp_path / "clean" / "background" / "cam1.png"))[..., ::-1][away]
    np.testing.assert_array_equal(clean, empty)
    assert abs((noisy - clean).std() - 3.0) < 0.15
    lost = (1.0 - dark / clean)[:, 1]
    assert 0.1 < lost.max() <= shaded + 0.02
    assert lost.min() > -0.02
    assert 0.005 < (lost > 0.1).mean() < 0.2
    gain = (drifting / clean)[:, 1]
    assert abs(gain.mean() - 1.0) > 0.002
    assert gain.std() < 0.01


def test_the_shadow_lies_where_the_light_falls(track):
    joints = dict(zip(JOINTS, np.moveaxis(track, 1, 0), strict=True))
    scene = light_scene(pose_surface(joints))
    for frame in range(len(track)):
        for name in ("Waist", "RKnee", "LElbow"):
            x, height, z = joints[name][frame]
            fallen = np.array([x + 0.28 * height, z + 0.22 * height])
            column, row = np.rint((fallen - scene.corner) / 0.02).astype(int)
            assert scene.shade[frame, row, column] > 60, name
            opposite = np.array([x - 0.28 * height - 0.7, z - 0.22 * height - 0.7])
            column, row = np.rint((opposite - scene.corner) / 0.02).astype(int)
            assert scene.shade[frame, row, column] < 10, name


def test_a_capture_folder_holds_what_the_design_asks_for(tmp_path, track, cameras):
    folder = tmp_path / "okuri"
    truth = film(folder, track, cameras, compressed=True, voxel_m=0.02)
    described = tomllib.loads((folder / "capture.toml").read_text(encoding="utf-8"))
    assert described["video"] == {"fps": 10.0, "up": "y"}
    assert described["volume"]["voxel_m"] == 0.02
    low = np.array(described["volume"]["center_m"]) - np.array(described["volume"]["size_m"]) / 2
    high = low + described["volume"]["size_m"]
    assert low[1] == 0.0
    assert (truth.vertex.min(axis=(0, 1)) > low - [0.0, 0.01, 0.0]).all()
    assert (truth.vertex.max(axis=(0, 1)) < high).all()
    capture = read_capture(folder)
    assert (capture.frames, capture.fps) == (len(track), 10.0)
    assert capture.metadata["performer"] == "generated"
    for camera, one in zip(cameras, capture.cameras, strict=True):
        assert (one.name, one.size) == (camera.name, camera.size)
        np.testing.assert_allclose(projected(one, track[0]), projected(camera, track[0]), atol=1e-6)
        video = cv2.VideoCapture(str(folder / "videos" / f"{camera.name}.mp4"))
        assert video.get(cv2.CAP_PROP_FRAME_COUNT) == len(track)
        assert video.get(cv2.CAP_PROP_FRAME_WIDTH) == 88
        assert (folder / "background" / f"{camera.name}.png").exists()


def test_the_truth_is_written_in_the_words_of_the_shared_captures(tmp_path, track, cameras):
    truth = film(tmp_path / "take", track, cameras[:2], clothes="kimono")
    with np.load(tmp_path / "take_truth.npz") as kept:
        names = kept["joint_names"].tolist()
        assert {"head_top", "neck", "r_finger", "l_toe", "l_heel", "r_shoulder"} <= set(names)
        np.testing.assert_allclose(kept["joints"][:, names.index("l_toe")], track[:, -1], atol=1e-6)
        masks = np.unpackbits(kept["masks"], axis=-1)[..., : kept["mask_shape"][-1]]
        np.testing.assert_array_equal(masks.astype(bool), truth.silhouette)
        assert masks.shape == tuple(kept["mask_shape"]) == (2, 2, 64, 88)
        segments = kept["segments"].tolist()
        assert segments[:5] == ["head", "body", "waist", "r_upper_arm", "r_forearm"]
        hand = kept["verts"][0, kept["vert_segment"] == segments.index("l_forearm")]
        tip = track[0, JOINTS.index("LFin")]
        assert np.linalg.norm(hand - tip, axis=1).min() < 0.02
        assert kept["verts"].shape == truth.vertex.shape


def test_a_folder_with_something_in_it_is_left_alone(tmp_path, track, cameras):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(InputError, match="is not empty; name a new one for the capture"):
        film(tmp_path, track, cameras)
    with pytest.raises(InputError, match=r"cannot be made \(.*\); choose a place that exists"):
        film(tmp_path / "mine.txt", track, cameras)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_what_cannot_be_filmed_is_named_all_at_once(tmp_path, track, cameras):
    settings = FilmSettings(samples=2)
    wanted = r"shape \(2, 20, 3\).* 0.0 frames a second.* 2 samples along a pixel, wanted is an odd"
    with pytest.raises(ValueError, match=wanted):
        film_capture(tmp_path / "take", track[:, 1:], 0.0, cameras=cameras, settings=settings)
    with pytest.raises(ValueError, match=r"backdrop is 'pink', .*; samples is 0, it must be"):
        FilmSettings(samples=0, backdrop="pink")  # type: ignore
    assert not list(tmp_path.iterdir())


def test_cameras_that_do_not_fit_together_are_refused(tmp_path, track, cameras):
    first = cameras[0]
    parts = (first.intrinsics, first.distortion, first.rotation, first.translation)
    wider = Camera("wide", (96, 64), *parts)
    with pytest.raises(ValueError, match=r"sizes .*\(88, 64\).*\(96, 64\).* images of one size"):
        film(tmp_path / "take", track, [first, wider])
    bent = Camera("fish", first.size, parts[0], np.full(8, 0.01), *parts[2:])
    with pytest.raises(ValueError, match="lenses of fish bend by k4 to k6; give cameras with k1"):
        film(tmp_path / "take", track, [first, bent])
    with pytest.raises(ValueError, match="0 cameras around and 0 above film nothing; ask for at"):
        generate_cameras(RingSettings(cameras=0))
