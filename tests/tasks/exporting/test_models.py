import json
import struct

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from storage.schema import JOINTS
from tasks.exporting.models import export_voxel_clip, write_joint_glb
from tests.conftest import swaying_body
from tests.figures.archives.dances import ORIGIN_M, SURFACE, VOXEL_M, box, make_dances

RATE_HZ = 60.0


def read_tracks(path):
    """The animation of a GLB file: by node and property, times and values; read by the format."""
    content = path.read_bytes()
    magic, version, size = struct.unpack_from("<4sII", content)
    assert (magic, version, size) == (b"glTF", 2, len(content))
    (long, kind) = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    scene = json.loads(content[20 : 20 + long])
    begin = 20 + long + 8

    def numbers(which):
        about = scene["accessors"][which]
        view = scene["bufferViews"][about["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[about["type"]]
        flat = np.frombuffer(content, "<f4", about["count"] * width, begin + view["byteOffset"])
        assert flat.min() >= min(about.get("min", [-np.inf])) - 1e-6
        return flat.reshape(-1, width)

    animation, found = scene["animations"][0], {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        name = scene["nodes"][channel["target"]["node"]]["name"]
        found[name, channel["target"]["path"]] = (
            numbers(sampler["input"]),
            numbers(sampler["output"]),
        )
    return scene, found


@pytest.fixture
def skeleton(tmp_path):
    position = swaying_body(3, 40)
    position[10:15, JOINTS.index("RFin")] = np.nan
    position[:, JOINTS.index("LFin")] = position[:, JOINTS.index("LWrist")] - [
        0,
        0.2,
        0,
    ]  # straight down
    write_joint_glb(tmp_path / "a.glb", position, JOINTS, RATE_HZ)
    return tmp_path / "a.glb", position


def test_joints_and_bones_are_where_the_track_has_them(skeleton):
    path, position = skeleton
    _, tracks = read_tracks(path)
    time_s, place = tracks["RKnee", "translation"]
    np.testing.assert_allclose(time_s[:, 0], np.arange(20) / 30, atol=1e-6)
    np.testing.assert_allclose(place, position[::2, JOINTS.index("RKnee")], atol=1e-6)
    for a, b in (("RHip", "RKnee"), ("LWrist", "LFin"), ("Neck", "Head")):
        start, size = tracks[f"{a}-{b}", "translation"][1], tracks[f"{a}-{b}", "scale"][1]
        turn = Rotation.from_quat(tracks[f"{a}-{b}", "rotation"][1])
        end = start + turn.apply(np.stack([0 * size[:, 1], size[:, 1], 0 * size[:, 1]], axis=1))
        np.testing.assert_allclose(end, position[::2, JOINTS.index(b)], atol=1e-5)


def test_what_is_missing_has_no_size(skeleton):
    _, tracks = read_tracks(skeleton[0])
    gone = np.arange(40)[::2][(tracks["RFin", "scale"][1] == 0).all(axis=1)]
    assert gone.tolist() == [10, 12, 14]
    assert (tracks["RWrist-RFin", "scale"][1][5:8] == 0).all()


def test_another_program_opens_the_skeleton(skeleton):
    path, position = skeleton
    scene = trimesh.load(path)
    assert len(scene.graph.nodes_geometry) > 40
    low, high = scene.bounds
    there = position[0][np.isfinite(position[0]).all(axis=1)]
    np.testing.assert_allclose(low, there.min(axis=0), atol=0.04)
    np.testing.assert_allclose(high, there.max(axis=0), atol=0.04)


def test_another_program_opens_the_voxels_in_their_places_and_colors(tmp_path):
    make_dances(tmp_path / "archive")
    told = export_voxel_clip(str(tmp_path / "archive"), "filmed", str(tmp_path / "v.glb"), (8, 11))
    assert told == [f"{tmp_path / 'v.glb'}: the voxels of 4 frames"]
    scene = trimesh.load(tmp_path / "v.glb")
    clouds = sorted(scene.geometry.values(), key=lambda cloud: cloud.bounds[0][0])
    assert len(clouds) == 4
    assert all(len(cloud.vertices) == SURFACE for cloud in clouds)
    occupied = np.argwhere(box(8))
    np.testing.assert_allclose(
        clouds[0].bounds[0], ORIGIN_M + VOXEL_M * occupied.min(axis=0), atol=1e-6
    )
    np.testing.assert_allclose(
        clouds[0].bounds[1], ORIGIN_M + VOXEL_M * occupied.max(axis=0), atol=1e-6
    )
    high = clouds[0].vertices[:, 1] > 1.02
    assert (clouds[0].colors[high][:, 2] > 150).all()
    assert (clouds[0].colors[~high][:, 0] > 150).all()
    _, tracks = read_tracks(tmp_path / "v.glb")
    shown = np.stack([tracks[f"frame {n}", "scale"][1][:4, 0] for n in range(8, 12)])
    np.testing.assert_array_equal(shown, np.eye(4))
    with pytest.raises(ValueError, match="frames 0-59; 50-60 goes beyond"):
        export_voxel_clip(str(tmp_path / "archive"), "filmed", str(tmp_path / "v.glb"), (50, 60))
    with pytest.raises(ValueError, match="has no voxels"):
        export_voxel_clip(str(tmp_path / "archive"), "asked", str(tmp_path / "v.glb"), (0, 1))
