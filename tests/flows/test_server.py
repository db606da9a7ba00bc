"""Tests of what shosa does when there is no Prefect server, or none that is well."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.metadata import version

import httpx
import pytest

from flows.command.main import main
from flows.server import ServerError, check_home, check_url, is_server_fault
from storage import open_archive
from storage.upkeep.verification import verify_take
from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.filming import FilmSettings, film_capture
from tests.conftest import HANGING_S, MEASURED, swaying_body

PREFECT = version("prefect")


@pytest.fixture
def web_server():
    """A function that starts a server with one answer, and a version, and returns its URL."""
    servers = []

    def start(status, text, version=(200, f'"{PREFECT}"')):
        class Answer(BaseHTTPRequestHandler):
            def do_GET(self):
                code, said = version if self.path == "/api/admin/version" else (status, text)
                self.send_response(code)
                self.end_headers()
                self.wfile.write(said.encode())

            def log_message(self, *_):
                pass

        server = HTTPServer(("127.0.0.1", 0), Answer)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/api"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


def test_a_server_that_is_well_is_taken(web_server):
    check_url(web_server(200, "true"))
    same_but_for_the_patch = ".".join([*PREFECT.split(".")[:2], "999"])
    check_url(web_server(200, "true", (200, f'"{same_but_for_the_patch}"')))


@pytest.mark.parametrize(
    ("version", "said"),
    [
        ((200, '"2.20.1"'), "is of version 2.20.1, and 3"),
        ((200, '"3.1.0"'), "is of version 3.1.0, and 3"),
        ((404, ""), "is of an unknown version, and 3"),
        ((401, ""), "wants a password; set PREFECT_API_AUTH_STRING"),
    ],
)
def test_a_server_of_another_version_is_told_at_once(
    web_server, version, said, monkeypatch, tmp_path, write_walk, capsys
):
    """In one sentence, by whatever command would tell it of runs."""
    url = web_server(200, "true", version)
    with pytest.raises(ServerError, match=said):
        check_url(url)
    archive, walk = str(tmp_path / "archive"), write_walk(tmp_path / "walk.trc")
    assert main(["serve", archive, "--join", url]) == 4
    monkeypatch.setenv("PREFECT_API_URL", url)
    assert main(["serve", archive]) == 4
    from prefect.settings import PREFECT_API_URL, temporary_settings

    with temporary_settings({PREFECT_API_URL: url}):
        assert main(["ingest", archive, str(walk)]) == 4
    out, err = capsys.readouterr()
    assert (out, err.count(said), err.count("\n")) == ("", 3, 3)


def test_the_password_of_a_server_is_sent(monkeypatch):
    """As Prefect's own client sends it."""
    monkeypatch.setenv("PREFECT_API_AUTH_STRING", "name:word")
    heard = []

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self):
            heard.append(self.headers["Authorization"])
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"true" if self.path == "/api/health" else f'"{PREFECT}"'.encode())

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        check_url(f"http://127.0.0.1:{server.server_port}/api")
        server.shutdown()
    assert heard == [httpx.BasicAuth("name", "word")._auth_header] * 2


@pytest.mark.parametrize(("status", "text"), [(200, "<html>"), (404, "true"), (503, "busy")])
def test_what_is_no_server_that_is_well_is_named(web_server, status, text):
    url = web_server(status, text)
    with pytest.raises(ServerError, match=rf"{url} is no Prefect server that is well.*{status}"):
        check_url(url)


@pytest.mark.parametrize("url", ["http://127.0.0.1:1/api", "http://", "nonsense", "ftp://x/api"])
def test_a_server_that_does_not_answer_is_named_with_what_to_do(url):
    with pytest.raises(ServerError, match=r"does not answer.*start it.*or unset PREFECT_API_URL"):
        check_url(url)


def test_a_home_that_cannot_be_written_to_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    check_home()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "file" / "home"))
    with pytest.raises(ServerError, match=r"cannot be written to.*set PREFECT_HOME to a folder"):
        check_home()


def test_the_command_says_so_before_a_run_starts(monkeypatch, tmp_path, write_walk, capsys):
    """In a sentence, with exit code 4; `doctor` says that it is bad."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "file" / "home"))
    file = write_walk(tmp_path / "walk.trc")
    assert main(["ingest", str(tmp_path / "archive"), str(file)]) == 4
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "set PREFECT_HOME" in err
    assert main(["doctor"]) == 4
    assert "BAD  Prefect keeps its runs in" in capsys.readouterr().out


def test_only_a_server_that_is_not_there_is_a_servers_fault():
    assert is_server_fault(httpx.ConnectError("refused"))
    assert is_server_fault(httpx.ReadTimeout("late"))
    assert not is_server_fault(httpx.InvalidURL("?"))
    assert not is_server_fault(OSError("full"))
    assert not is_server_fault(ValueError("wrong"))


GONE = """
import os, signal, sys
from storage import blocks
capture, archive, server = sys.argv[1:]
write = blocks.write_file
def write_file(place, path, content):
    if "coloring" in path:
        try:
            os.killpg(int(server), signal.SIGKILL)
        except ProcessLookupError:
            pass
    write(place, path, content)
blocks.write_file = write_file
from flows.command.main import main
sys.exit(main(["ingest", archive, capture]))
"""


@pytest.fixture
def own_server(tmp_path):
    """A Prefect server of its own: its API's address and its process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-m", "prefect", "server", "start", "--port", str(port)],
        env={
            **{name: value for name, value in os.environ.items() if name != MEASURED},
            "PREFECT_HOME": str(tmp_path / "home"),
            "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        },
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    url = f"http://127.0.0.1:{port}/api"
    deadline = time.monotonic() + HANGING_S
    while True:
        try:
            check_url(url)
            break
        except ServerError:
            assert time.monotonic() < deadline, "the server did not start"
            time.sleep(0.5)
    yield url, process
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.long
@pytest.mark.flow
@pytest.mark.slow
def test_a_server_that_goes_away_in_a_digitization_harms_nothing(own_server, tmp_path):
    """The take is finished and published, one sentence says so, and nothing of Prefect's."""
    url, server = own_server
    track = swaying_body(3, 8)
    cameras = generate_cameras(
        RingSettings(cameras=5, size=(80, 60), radius_m=3.5), center_m=(0.0, 0.9, 0.0), seed=4
    )
    film_capture(
        tmp_path / "dancer", track, 30.0, cameras=cameras, settings=FilmSettings(voxel_m=0.05)
    )
    program = [sys.executable, "-c", GONE, str(tmp_path / "dancer"), str(tmp_path / "archive")]
    done = subprocess.run(
        [*program, str(server.pid)],
        env={
            **os.environ,
            "PREFECT_API_URL": url,
            "PREFECT_HOME": str(tmp_path / "other"),
            "PREFECT_CLIENT_MAX_RETRIES": "0",  # as it is after some seconds otherwise
        },
        capture_output=True, text=True, timeout=HANGING_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert server.wait() == -signal.SIGKILL
    assert done.stdout.splitlines()[1].startswith("ingested")
    assert verify_take(open_archive(tmp_path / "archive").place, "dancer") == []
    assert done.stderr.count("the Prefect server does not answer any more") == 1
    for said in ("Traceback", "prefect.", "httpx", "API"):
        assert said not in done.stderr
