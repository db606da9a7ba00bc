"""What tests of several folders share: recordings, one Prefect server, an S3 server, files."""

import os
import re
import socket
import subprocess
import sys
import time
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from storage.formats.motion.trc import write_trc
from storage.schema import JOINTS

ROOT = Path(__file__).parent.parent

HANGING_S = 1800
"""How long anything may take before it hangs [s]. Some hundred times what an idle machine takes."""

MEASURED = "COVERAGE_PROCESS_CONFIG"
"""The variable by which coverage measures the programs that a test starts."""

settings.register_profile("usual", derandomize=True, deadline=timedelta(seconds=HANGING_S))
settings.register_profile("long", parent=settings.get_profile("usual"), derandomize=False)
settings.load_profile("usual")


def cases(number: int) -> int:
    """Return how many cases a test draws: `number`, or 20 times as many in `make test-long`."""
    return number * (20 if settings.get_current_profile_name() == "long" else 1)


LONGEST = (
    "test_serving.py",
    "test_digitization.py",
    "test_flows.py",
    "test_search_page.py",
    "test_changing_archives.py",
    "test_examination.py",
)
"""Files that take a minute or more, the longest first: at the end, one core would wait for them."""


def pytest_collection_modifyitems(items):
    """Put long files first, so that both cores are busy to the end; flows and S3 before browsers.

    Where a browser was opened a loop of events goes on, in which Prefect gives coroutines back.
    """
    weights = {}
    for item in items:
        marks = [bool(item.get_closest_marker(name)) for name in ("flow", "s3", "slow", "compiled")]
        weights[item.path] = max(weights.get(item.path, marks), marks)
    ranks = {name: len(LONGEST) - rank for rank, name in enumerate(LONGEST)}

    def order(item):
        own = weights[item.path]
        return own[0] or own[1], ranks.get(item.path.name, 0), own

    items.sort(key=order, reverse=True)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of the shared recordings; tests that need it are marked `data`."""
    folder = Path(os.environ.get("SHOSA_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the shared recordings are not at {folder}; set SHOSA_DATA")
    return folder


@pytest.fixture(scope="session")
def prefect_server():
    """One Prefect server for the whole session: it takes 20 s to start."""
    from prefect.testing.utilities import prefect_test_harness

    import flows  # noqa: F401 - sets the time that the server has to start

    measured = os.environ.pop(MEASURED, None)  # a server runs nothing of ours
    with prefect_test_harness(server_startup_timeout=HANGING_S):
        if measured is not None:
            os.environ[MEASURED] = measured
        yield


@pytest.fixture(scope="module")
def object_store_server():
    """A real S3 server on loopback: its URL, and its process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    process = subprocess.Popen(
        command,
        env={name: value for name, value in os.environ.items() if name != MEASURED},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + HANGING_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            break
        except OSError:
            assert time.monotonic() < deadline, "the S3 server did not start"
            time.sleep(0.2)
    yield f"http://127.0.0.1:{port}", process
    process.kill()
    process.wait()


@pytest.fixture
def object_store(object_store_server, monkeypatch, request):
    """The URL of an empty place in a bucket, with the environment that says how to reach it."""
    import boto3

    for name, value in {
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_REGION": "us-east-1",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": object_store_server[0],
        "AWS_ALLOW_HTTP": "true",
    }.items():
        monkeypatch.setenv(name, value)
    boto3.client("s3").create_bucket(Bucket="shosa-test")
    return f"s3://shosa-test/{re.sub('[^a-z0-9]+', '-', request.node.name)}"


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 256 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can make a small disk here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def write_walk():
    """A function that writes a small motion file of a swaying body."""

    def write(path: Path, *, seed: int = 0, frames: int = 90) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_trc(path, swaying_body(seed, frames), JOINTS, 30.0)
        return path

    return write


def swaying_body(seed: int, frames: int) -> np.ndarray:
    """A standing body of 1.6 m whose joints sway, every seed in its own way; (time, 21, 3)."""
    height = {
        "Head": 1.60, "Neck": 1.35, "Waist": 1.0, "Shoulder": 1.32, "Elbow": 1.05, "Wrist": 0.82,
        "Fin": 0.65, "Hip": 0.85, "Knee": 0.45, "Ankle": 0.08, "Heel": 0.0, "Foot": 0.0,
    }  # fmt: skip
    aside = {"Shoulder": 0.18, "Elbow": 0.24, "Wrist": 0.26, "Fin": 0.27}
    rng = np.random.default_rng(seed)
    body = np.zeros((frames, len(JOINTS), 3))
    time = np.arange(frames)[:, None] / 30.0
    for number, joint in enumerate(JOINTS):
        name = joint if joint in height else joint[1:]
        side = {"R": -1.0, "L": 1.0}.get(joint[0], 0.0) * (joint not in height)
        rest = [side * aside.get(name, 0.1), height[name], 0.1 * (name == "Foot")]
        sway = np.sin(time * rng.uniform(1, 4, 3) + rng.uniform(0, 6, 3)) * 0.05
        body[:, number] = rest + sway * [1.0, name not in ("Heel", "Foot", "Ankle"), 1.0]
    return body
