import json

import numpy as np
import pytest

from flows.command.main import BAD_INPUT, DONE, main
from storage.formats.capture.camera_plan import read_camera_plan
from storage.formats.capture.capture_toml import Volume
from tasks.checks.layouts import judge_layout, report_layout
from tasks.studio.cameras import RingSettings, generate_cameras

VOLUME = Volume((0.0, 1.0, 0.0), (2.4, 2.1, 2.4), 0.01)
VOXEL_M = 0.05

CAMERA = """
[[camera]]
position_m = [{x}, 1.0, {z}]
look_at_m = [0.0, 1.0, 0.0]
field_of_view_deg = 60
size_px = [320, 240]
"""


def ring(count, **settings):
    return generate_cameras(
        RingSettings(cameras=count, distortion=(0.0, 0.0), spread=0.0, **settings),
        center_m=VOLUME.center_m,
    )


@pytest.mark.compiled
@pytest.mark.slow
def test_more_cameras_carve_closer_and_a_lost_one_costs():
    few, many = (judge_layout(ring(count), VOLUME, voxel_m=VOXEL_M) for count in (4, 12))
    assert (many.excess < few.excess).all()
    assert few.excess.min() > 0.1
    assert many.excess.min() > -0.1
    assert (few.excess_without > few.excess.mean()).all()
    assert few.seen_by.sum() == pytest.approx(1.0)
    assert few.seen_by[3] + few.seen_by[4] > 0.5
    assert len(few.seen_by) == 5


@pytest.mark.compiled
def test_the_share_and_the_pixel_are_those_of_a_pinhole():
    narrow = ring(3, field_of_view=0.2)
    report = judge_layout(narrow, VOLUME, voxel_m=0.1)
    side = np.linspace(-1.175, 1.175, 48)
    x, y, z = np.meshgrid(side, np.linspace(-0.025, 2.025, 42), side, indexing="ij")
    camera = narrow[0]
    point = np.stack([x, y, z], -1) @ camera.rotation.T + camera.translation
    film = point @ camera.intrinsics.T
    u, v = film[..., 0] / film[..., 2], film[..., 1] / film[..., 2]
    inside = (u > -0.5) & (u < 319.5) & (v > -0.5) & (v < 239.5)
    assert report.share[0] == pytest.approx(inside.mean(), abs=0.01)
    away = np.linalg.norm(np.array(VOLUME.center_m) + camera.rotation.T @ camera.translation)
    assert report.pixel_m[0] == pytest.approx(away / camera.intrinsics[0, 0], rel=0.1)
    assert np.isnan(report.excess_without).all()  # two cameras carve nothing


@pytest.mark.compiled
def test_a_volume_that_cuts_arms_off_is_said():
    slim = Volume((0.0, 1.0, 0.0), (0.6, 2.1, 0.6), 0.01)
    report = judge_layout(ring(4), slim)
    assert report.lost[0] > 0.05  # the arms are stretched
    assert any("outside the volume" in line for line in report_layout(report))


def test_fewer_than_three_cameras_are_refused(tmp_path, capsys):
    with pytest.raises(ValueError, match="2 cameras carve nothing: 3 or more"):
        judge_layout(ring(2), VOLUME)
    file = tmp_path / "two.toml"
    file.write_text(CAMERA.format(x=3.0, z=0.0) + CAMERA.format(x=0.0, z=3.0))
    assert main(["plan", str(file)]) == BAD_INPUT
    assert "has 2 cameras; a hull needs 3 or more" in capsys.readouterr().err


@pytest.mark.compiled
@pytest.mark.slow
def test_the_command_prints_a_table_and_json(tmp_path, capsys):
    file = tmp_path / "plan.toml"
    text = "".join(CAMERA.format(x=x, z=z) for x, z in ((3.5, 0), (0, 3.5), (-3.5, 0)))
    file.write_text(text)
    assert main(["plan", str(file)]) == DONE
    said = capsys.readouterr().out
    assert "cam3" in said
    assert "hull against that of 40 cameras: +" in said
    assert main(["plan", str(file), "--json"]) == DONE
    found = json.loads(capsys.readouterr().out)
    assert found["cameras"] == ["cam1", "cam2", "cam3"]
    assert found["pixel_mm"][0] == pytest.approx(1000 * 3.5 * 2 * np.tan(np.pi / 6) / 320)


def test_a_camera_of_a_plan_looks_where_it_should(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text("[volume]\ncenter_m=[1,1,0]\nsize_m=[3,2,4]\n" + CAMERA.format(x=3.0, z=4.0))
    [camera], volume, _ = read_camera_plan(file)
    assert volume.size_m == (3.0, 2.0, 4.0)
    inside = camera.rotation @ [0.0, 1.0, 0.0] + camera.translation
    np.testing.assert_allclose(inside, [0.0, 0.0, 5.0], atol=1e-12)
    higher = camera.rotation @ [0.0, 2.0, 0.0] + camera.translation
    assert higher[1] < 0  # y of an image points down
    assert np.linalg.det(camera.rotation) == pytest.approx(1.0)
    edge = camera.intrinsics[0, 0] * np.tan(np.pi / 6)
    assert edge == pytest.approx(160.0)


def test_all_faults_of_a_plan_are_said_at_once(tmp_path, capsys):
    file = tmp_path / "plan.toml"
    text = CAMERA.format(x=3.0, z="nan") + CAMERA.format(x=0.0, z=0.0)
    file.write_text("[volume]\ncenter_m=[1,1]\n" + text)
    assert main(["plan", str(file)]) == BAD_INPUT
    said = capsys.readouterr().err
    for words in (
        "[volume] needs center_m and size_m", "'cam1' needs position_m (3 numbers)",
        "'cam2' should look at another point",
    ):  # fmt: skip
        assert words in said
    file.write_text("[[camera")
    assert main(["plan", str(file)]) == BAD_INPUT
    assert "is not TOML" in capsys.readouterr().err
    assert main(["plan", str(tmp_path / "none.toml")]) == BAD_INPUT
    assert "none.toml cannot be read: No such file" in capsys.readouterr().err
