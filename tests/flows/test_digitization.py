"""Tests of the flow from films to colored voxels, on a tiny generated capture."""

import json
import os
import shutil
import signal
import subprocess
import sys
from datetime import timedelta

import cv2
import numpy as np
import pytest

from storage import open_archive
from storage.arrays.groups import open_group
from storage.formats.capture.capture import read_capture
from storage.places import list_files
from storage.publication import version_folder
from storage.schema import JOINTS
from storage.upkeep.garbage import collect_garbage
from storage.upkeep.verification import verify_take
from tasks.body.doubt.reasons import DoubtSettings
from tasks.capture import films as capture_films
from tasks.capture.empty_stages import read_backgrounds
from tasks.exporting.voxels import export_initial
from tasks.geometry.voxels import decode_runs
from tasks.reconstruction.carving import CarvingSettings, carve_visual_hull
from tasks.reconstruction.coloring import ColoringSettings, color_surface
from tasks.reconstruction.silhouettes import extract_silhouettes
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, generate_performance
from tests.conftest import HANGING_S, swaying_body

pytestmark = [pytest.mark.flow, pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]

FRAMES = 18
RING = RingSettings(cameras=5, size=(80, 60), radius_m=3.5)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("films") / "dancer"
    track = generate_performance([okuri48()], TK, rate_hz=10.0).position[:FRAMES]
    cameras = generate_cameras(RING, center_m=(0.0, 0.9, 0.0), seed=4)
    film_capture(folder, track, 10.0, cameras=cameras, settings=FilmSettings(voxel_m=0.05))
    return folder


MOMENTS = ("coloring-00000008", "pose_fitting-00000000", "publishing")
"""The block before whose writing the program is killed, or the last stage."""

KILLED = """
import os, signal, sys
from flows import digitization, ingestion
from storage import blocks
from tasks.capture import films as capture_films
capture_films._BLOCK_FRAMES = 8
capture, archive, moment = sys.argv[1:]
write, publish = blocks.write_file, digitization.publish_take
def write_file(place, path, content):
    if moment in path:
        os.kill(os.getpid(), signal.SIGKILL)
    write(place, path, content)
def publish_take(*arguments, **more):
    if moment == "publishing":
        os.kill(os.getpid(), signal.SIGKILL)
    return publish(*arguments, **more)
blocks.write_file, digitization.publish_take = write_file, publish_take
outcome = ingestion.run_ingestion(archive, [capture])[0]
sys.exit(outcome.reason if outcome.status != "ingested" else 0)
"""


@pytest.fixture(scope="module")
def posed(tmp_path_factory):
    """A capture that begins with the arms stretched, so that it gets a pose."""
    folder = tmp_path_factory.mktemp("films") / "posed"
    track = stretch_arms_first(swaying_body(3, 30), 30.0)[:12]
    cameras = generate_cameras(
        RingSettings(cameras=6, size=(160, 120)), center_m=(0.0, 0.9, 0.0), seed=4
    )
    film_capture(folder, track, 30.0, cameras=cameras, settings=FilmSettings(voxel_m=0.025), seed=2)
    return folder


@pytest.fixture
def truth_of(filmed):
    return filmed.with_name("dancer_truth.npz")


@pytest.fixture
def capture(filmed, tmp_path, monkeypatch):
    monkeypatch.setattr(capture_films, "_BLOCK_FRAMES", 8)
    return shutil.copytree(filmed, tmp_path / "dancer")


@pytest.fixture
def ingest(tmp_path, capture):
    from flows.ingestion import run_ingestion

    return lambda: run_ingestion(str(tmp_path / "archive"), [str(capture)])[0]


def test_what_is_stored_is_what_the_stages_make_of_all_frames_at_once(ingest, capture, tmp_path):
    outcome = ingest()
    assert outcome.status == "ingested", outcome.reason
    assert any("has no pose and is not searched" in note for note in outcome.notes)
    take = open_archive(tmp_path / "archive").take("dancer")
    assert "motion" not in take.record.stages
    source = read_capture(capture)
    backgrounds = read_backgrounds(source)
    [*parts] = capture_films.read_films(source, 0, FRAMES)
    films = [np.concatenate([films[c] for _, films in parts]) for c in range(5)]
    silhouettes = np.stack(
        [extract_silhouettes(f, b) for f, b in zip(films, backgrounds, strict=True)], axis=1
    )
    np.testing.assert_array_equal(take.silhouettes, silhouettes)
    projection, grid = capture_films.projection_of(source.cameras), capture_films.grid_of(source)
    for t in range(FRAMES):
        hull = carve_visual_hull(silhouettes[t], projection, grid, CarvingSettings())
        np.testing.assert_array_equal(take.occupied(t), decode_runs(hull, 0))
        images = np.stack([film[t] for film in films])
        colored = color_surface(hull, grid, images, silhouettes[t], projection, ColoringSettings())
        voxels = take.voxels(t)
        is_surface = voxels["is_surface"].values
        np.testing.assert_array_equal(voxels["color"].values[is_surface], colored.color)
        np.testing.assert_array_equal(voxels["camera"].values[is_surface], colored.camera)
    place = open_archive(tmp_path / "archive").place
    assert verify_take(place, "dancer") == []
    assert list_files(place, "work") == []


def test_masks_are_the_silhouettes_and_another_mask_is_another_content(
    ingest, capture, truth_of, tmp_path
):
    with np.load(truth_of) as arrays:
        columns = arrays["mask_shape"][-1]
        truth = np.unpackbits(arrays["masks"], axis=-1, count=columns).astype(bool)
    shutil.rmtree(capture / "background")
    for c in range(truth.shape[1]):
        folder = capture / "silhouettes" / f"cam{c + 1}"
        folder.mkdir(parents=True)
        for n, mask in enumerate(truth[:, c]):
            cv2.imwrite(str(folder / f"{n}.png"), mask * np.uint8(255))
    outcome = ingest()
    assert outcome.status == "ingested", outcome.reason
    take = open_archive(tmp_path / "archive").take("dancer")
    np.testing.assert_array_equal(take.silhouettes, truth)
    assert ingest().status == "unchanged"
    cv2.imwrite(str(capture / "silhouettes" / "cam2" / "5.png"), truth[5, 1] * np.uint8(255) // 3)
    assert ingest().status == "ingested"
    take = open_archive(tmp_path / "archive").take("dancer")
    assert take.record.number == 2
    assert not take.silhouettes[5, 1].any()
    np.testing.assert_array_equal(take.silhouettes[6], truth[6])


def test_what_did_not_change_is_not_computed_again_and_a_change_is_a_new_version(
    ingest, capture, tmp_path
):
    assert ingest().status == "ingested"
    assert ingest().status == "unchanged"
    text = (capture / "capture.toml").read_text()
    (capture / "capture.toml").write_text(text.replace("voxel_m = 0.05", "voxel_m = 0.06"))
    assert ingest().status == "ingested"
    take = open_archive(tmp_path / "archive").take("dancer")
    assert (take.record.number, take.voxels(3).attrs["voxel_m"]) == (2, 0.06)


def test_settings_of_the_capture_and_of_the_run_are_used_kept_and_told(posed, tmp_path):
    """The run's win; what was really used is in the provenance of each array."""
    from flows.ingestion import run_ingestion

    folder, archive = shutil.copytree(posed, tmp_path / "posed"), str(tmp_path / "archive")
    (folder / "digitize.toml").write_text(
        '[silhouettes]\nrule = "crcb"\n[joint_tracks]\nradius = 0.05\n'
    )
    given = {"joint_tracks": {"radius": 0.06}, "pose_fitting": {"method": "paper"}}
    outcome = run_ingestion(archive, [str(folder)], settings=given)[0]
    assert outcome.status == "ingested", outcome.reason
    assert any("joint_tracks.radius is set by digitize.toml" in note for note in outcome.notes)
    take = open_archive(archive).take("posed")
    assert take.record.settings == {
        "silhouettes.rule": "crcb",
        "pose_fitting.method": "paper",
        "joint_tracks.radius": 0.06,
    }
    silhouettes = open_group(
        open_archive(archive).place, version_folder("posed", take.record.version), "silhouettes"
    )
    assert silhouettes.attrs["provenance"]["settings"]["rule"] == "crcb"
    assert take.pose.attrs["provenance"]["settings"]["method"] == "paper"
    assert "doubt" not in take.pose  # as in takes of before
    assert take.motion.attrs["provenance"]["settings"]["radius"] == 0.06
    assert run_ingestion(archive, [str(folder)], settings=given)[0].status == "unchanged"
    assert run_ingestion(archive, [str(folder)])[0].status == "ingested"  # other settings
    take = open_archive(archive).take("posed")
    assert take.record.settings["joint_tracks.radius"] == 0.05
    doubt = take.pose["doubt"]
    assert (doubt.dims, doubt.dtype) == (("time", "segment"), np.float32)
    assert ((doubt >= 0) & (doubt <= 1)).all()
    limit = DoubtSettings().doubtful
    np.testing.assert_array_equal(take.pose["doubtful"], doubt.max("segment") > limit)


def test_a_capture_with_wrong_settings_is_refused_alone(ingest, capture):
    (capture / "digitize.toml").write_text("[carving]\nmin_cameras = 0\n[color]\n")
    outcome = ingest()
    assert outcome.status == "refused"
    assert "digitize.toml cannot be used" in outcome.reason
    assert "carving.min_cameras = 0 should be" in outcome.reason
    assert "no stage 'color'; coloring is meant?" in outcome.reason


def test_finished_blocks_are_kept_and_a_damaged_one_is_made_again(ingest, tmp_path, monkeypatch):
    from flows import digitization

    def broken(*_, **__):
        raise RuntimeError("the machine is switched off")

    with monkeypatch.context() as patched:
        patched.setattr(digitization, "assemble_take", broken)
        assert ingest().status == "failed"
    place = open_archive(tmp_path / "archive").place
    blocks = [place.folder / file.path for file in list_files(place, "work")]
    blocks = [path for path in blocks if path.suffix == ".npz"]
    assert len(blocks) == 10
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in blocks}
    blocks[0].write_bytes(b"damaged")
    blocks[4].unlink()
    with monkeypatch.context() as patched:
        patched.setattr(digitization, "assemble_take", broken)
        assert ingest().status == "failed"
    for path, (mtime, content) in before.items():
        assert path.read_bytes() == content
        assert (path.stat().st_mtime_ns == mtime) == (path not in (blocks[0], blocks[4]))
    assert len(collect_garbage(place, older_than=timedelta(0))) == 20
    assert ingest().status == "ingested"


@pytest.mark.parametrize(
    "moments",
    [MOMENTS[1:2], pytest.param(MOMENTS, marks=pytest.mark.long)],
    ids=["one", "all"],
)
def test_a_run_killed_at_any_moment_is_gone_on_with_to_the_same_arrays(posed, tmp_path, moments):
    """Killed within each stage, and when the take has been put together."""
    from prefect.settings import PREFECT_API_URL

    environment = {**os.environ, "PREFECT_API_URL": str(PREFECT_API_URL.value())}
    program = [sys.executable, "-c", KILLED, str(posed), str(tmp_path / "archive")]
    kept, made = {}, []
    for moment in moments:
        process = subprocess.run(
            [*program, moment], env=environment, capture_output=True, text=True, timeout=HANGING_S
        )
        assert process.returncode == -signal.SIGKILL, process.stderr[-2000:]
        place = open_archive(tmp_path / "archive").place
        assert open_archive(place.location).takes() == []
        there = {file.path: (place.folder / file.path).stat().st_mtime_ns
                 for file in list_files(place, "work")}  # fmt: skip
        assert kept.items() <= there.items(), f"computed again before {moment}"
        made.append(len(there) - len(kept))
        kept = there
    assert all(made), dict(zip(moments, made, strict=True))
    for archive in ("archive", "undisturbed"):
        subprocess.run(
            [*program[:-1], str(tmp_path / archive), "never"],
            env=environment,
            check=True,
            timeout=HANGING_S,
        )
    digests = []
    for archive in ("archive", "undisturbed"):
        opened = open_archive(tmp_path / archive)
        assert verify_take(opened.place, "posed") == []
        assert list_files(opened.place, "work") == []
        record = opened.take("posed").record
        assert "pose" in record.stages, record.notes
        digests.append({
            name: file["sha256"] for name, file in record.files.items() if "/c/" in name
        })  # fmt: skip
    assert digests[0] == digests[1]
    assert len(digests[0]) > 20


def test_joints_that_a_person_corrected_stay_where_they_were_put(posed, tmp_path):
    from flows.ingestion import run_ingestion

    folder, archive = shutil.copytree(posed, tmp_path / "posed"), str(tmp_path / "archive")
    assert run_ingestion(archive, [str(folder)])[0].status == "ingested"
    export_initial(archive, "posed", str(folder / "initial.json"))
    corrected = json.loads((folder / "initial.json").read_text(encoding="utf-8"))
    corrected["joints"]["RElbow"][1] += 0.01
    (folder / "initial.json").write_text(json.dumps(corrected), encoding="utf-8")
    assert run_ingestion(archive, [str(folder)])[0].status == "ingested"
    body = open_archive(archive).take("posed").body
    given = [corrected["joints"][name] for name in JOINTS]
    np.testing.assert_allclose(body["initial_joint"].values, given, atol=1e-6)


def test_a_truncated_film_is_refused_with_its_camera(ingest, capture, tmp_path):
    film = capture / "videos" / "cam2.mp4"
    film.write_bytes(film.read_bytes()[:2000])
    outcome = ingest()
    assert outcome.status == "refused"
    assert "cam2" in outcome.reason
    assert open_archive(tmp_path / "archive").takes() == []
    assert list_files(open_archive(tmp_path / "archive").place, "takes") == []
