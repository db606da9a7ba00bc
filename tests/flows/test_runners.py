"""Where tasks run: in threads or on Dask workers, with the same take at the end."""

import json
import os
import signal
import socket
import sys

import numpy as np
import pytest

from flows.command.main import DONE, RUN_FAILED, WRONG_USE, main
from flows.runners import spread_blocks, task_runner
from storage import create_archive, open_archive
from tasks.capture import films as capture_films
from tasks.retrieval.gathering import gather_segments
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.choreography import okuri48
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.performances import TK, generate_performance
from tests.figures.archives.imported import take_in_plainly

FRAMES = 16


def test_threads_are_the_usual_runner():
    from prefect.task_runners import ThreadPoolTaskRunner

    assert isinstance(task_runner("threads"), ThreadPoolTaskRunner)
    assert spread_blocks() is None  # this is no Dask worker


@pytest.mark.parametrize(
    "name",
    ["", "dusk", "dask://", "dask://host", "dask://host:0", "dask://host:99999", "tcp://h:1"],
)
def test_a_runner_that_is_none_is_wrong_use(name):
    with pytest.raises(
        ValueError, match=r"there is no runner .*; choose threads, dask, or dask://"
    ):
        task_runner(name)


def test_a_missing_library_is_said_with_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"needs Dask; .* with its extra: .*shosa\[dask"):
        task_runner("dask")


def test_a_scheduler_that_is_not_there_is_said_at_once():
    pytest.importorskip("prefect_dask")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(ConnectionError, match=rf"no Dask scheduler answers at dask://127.*:{port}"):
        task_runner(f"dask://127.0.0.1:{port}")


def test_the_command_refuses_a_runner_before_anything_is_begun(tmp_path, write_walk, capsys):
    walk = write_walk(tmp_path / "walk.trc")
    command = ["ingest", str(tmp_path / "archive"), str(walk), "--runner"]
    assert main([*command, "dusk"]) == WRONG_USE
    assert "there is no runner 'dusk'" in capsys.readouterr().err
    pytest.importorskip("prefect_dask")
    assert main([*command, "dask://127.0.0.1:1"]) == RUN_FAILED
    assert "no Dask scheduler answers" in capsys.readouterr().err
    search = ["search", str(tmp_path / "archive"), "walk", "--runner", "dask://127.0.0.1:1"]
    assert main(search) == RUN_FAILED
    assert "no Dask scheduler answers" in capsys.readouterr().err
    assert open_archive(tmp_path / "archive").takes() == []


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Films of two blocks, without a pose: the stages that are spread are those before it."""
    folder = tmp_path_factory.mktemp("films") / "dancer"
    track = generate_performance([okuri48()], TK, rate_hz=10.0).position[:FRAMES]
    ring = RingSettings(cameras=5, size=(80, 60), radius_m=3.5)
    cameras = generate_cameras(ring, center_m=(0.0, 0.9, 0.0), seed=4)
    film_capture(folder, track, 10.0, cameras=cameras, settings=FilmSettings(voxel_m=0.05))
    return folder


def use_small_blocks():
    """Let a process make blocks of eight frames."""
    capture_films._BLOCK_FRAMES = 8


def die_in_the_second_block(mark):
    """Let the first process that colors the second block be killed there, once."""
    use_small_blocks()
    from tasks import cached
    from tasks.reconstruction import coloring

    write = coloring.write_block

    def write_block(place, path, frames, *arguments, **options):
        if frames[0] == 8:
            try:
                os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                pass
            else:
                os.kill(os.getpid(), signal.SIGKILL)
        return write(place, path, frames, *arguments, **options)

    assert cached.color_block is coloring.color_block
    coloring.write_block = write_block


@pytest.mark.flow
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("prefect_server")
def test_blocks_on_workers_make_the_same_take_also_when_one_is_killed(
    capture, tmp_path, monkeypatch
):
    """Two worker processes; the one that colors the second block is killed in the middle of it."""
    dask = pytest.importorskip("prefect_dask")
    import distributed

    from flows.ingestion import ingest_archive

    monkeypatch.setattr(capture_films, "_BLOCK_FRAMES", 8)
    ingest_archive(str(tmp_path / "threads"), [str(capture)])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            client.run(die_in_the_second_block, str(tmp_path / "killed"))
            client.register_worker_callbacks(use_small_blocks)
        runner = dask.DaskTaskRunner(address=cluster.scheduler_address)
        ingest_archive.with_options(task_runner=runner)(str(tmp_path / "dask"), [str(capture)])
    assert (tmp_path / "killed").exists()
    one, other = (open_archive(tmp_path / name).take("dancer") for name in ("threads", "dask"))
    np.testing.assert_array_equal(one.silhouettes, other.silhouettes)
    for frame in range(FRAMES):
        assert one.voxels(frame).identical(other.voxels(frame))
    assert one.record.notes == other.record.notes


@pytest.mark.slow
@pytest.mark.long
def test_a_search_by_a_cluster_prints_what_one_here_prints(tmp_path, write_walk, capsys):
    pytest.importorskip("prefect_dask")
    archive = str(create_archive(tmp_path / "archive").location)
    for seed in range(3):
        walk = write_walk(tmp_path / f"walk{seed}.trc", seed=seed)
        take_in_plainly(archive, walk)
        gather_segments(archive)
    answers = []
    for runner in ("threads", "dask"):
        assert main(["search", archive, "walk1:20-50", "--json", "--runner", runner]) == DONE
        answers.append(json.loads(capsys.readouterr().out))
        del answers[-1]["seconds"]
    assert answers[0] == answers[1]
    assert answers[0]["matches"]
