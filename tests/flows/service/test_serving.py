"""Tests of `shosa serve`: one real server, worker and schedule, which are killed and go on.

The tests of this file share one served archive and run in their order.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest

from flows.command.main import main
from flows.service import serving
from flows.service.environment import environment_of
from flows.service.processes import served_processes
from flows.service.served import ENDED, Served, ServingError
from storage import open_archive
from storage.upkeep.verification import verify_take
from tests.conftest import HANGING_S, MEASURED, ROOT

BROKEN = "PathFileType\t4\n"


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def until(is_so, what):
    """Wait until something is so."""
    deadline = time.monotonic() + HANGING_S
    while not (found := is_so()):
        assert time.monotonic() < deadline, what
        time.sleep(0.5)
    return found


class Serve:
    """A `shosa serve` in a process of its own."""

    def __init__(self, folder):
        self.archive, self.inbox = folder / "archive", folder / "inbox"
        self.inbox.mkdir()
        self.port = free_port()
        self.api = f"http://127.0.0.1:{self.port}/api"
        kept = {
            k: v for k, v in os.environ.items() if not k.startswith("PREFECT_") and k != MEASURED
        }
        self.environment = {
            **kept,
            "PREFECT_HOME": str(folder / "home"),
            "PYTHONPATH": str(ROOT),
            "PYTHONUNBUFFERED": "1",
        }
        self.log = folder / "serve.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                self.command(
                    "--port", str(self.port), "--every", "20", "--settle", "1", "--limit", "4"
                ),
                env=self.environment,
                stderr=log,
            )

    def command(self, *options):
        shosa = [sys.executable, "-m", "flows.command.main", "serve", str(self.archive)]
        return [*shosa, "--inbox", str(self.inbox), *options]

    def ask(self, path, body=None):
        request = urllib.request.Request(f"{self.api}/{path}")
        if body is not None:
            request.data = json.dumps(body).encode()
            request.add_header("content-type", "application/json")
        while True:  # a busy server says 503, and that it is to be asked again
            try:
                with urllib.request.urlopen(request, timeout=HANGING_S) as answer:
                    return json.load(answer)
            except urllib.error.HTTPError as error:
                if error.code != 503:
                    raise
                time.sleep(1)

    def start(self, deployment, **parameters):
        """Fill in a form; returns the number of the run."""
        found = self.ask(f"deployments/name/{deployment}/{deployment}")
        run = self.ask(f"deployments/{found['id']}/create_flow_run", {"parameters": parameters})
        return run["id"]

    def end(self, run):
        """A run, when it has ended."""

        def ended():
            now = self.ask(f"flow_runs/{run}")
            return now if now["state_type"] in ("COMPLETED", "FAILED", "CRASHED") else None

        return until(ended, f"{run} does not end")

    def runs(self, **state):
        wanted = {"flow_runs": {"state": {"type": {"any_": state["of"]}}}}
        return self.ask("flow_runs/filter", wanted)

    def processes(self):
        """The processes that it started, and those that they started: what each runs, by number."""
        home = self.environment["PREFECT_HOME"]
        return {each.number: each.said for each in served_processes(home)}

    def takes(self):
        return open_archive(self.archive).takes() if (self.archive / "published").is_dir() else []


@pytest.fixture(scope="module")
def serve(tmp_path_factory):
    serve = Serve(tmp_path_factory.mktemp("serve"))
    try:
        yield serve
    finally:
        serve.process.terminate()
        serve.process.wait(HANGING_S)


@pytest.mark.flow
@pytest.mark.slow
def test_a_scheduled_run_takes_in_what_is_dropped_and_it_can_be_searched(serve, write_walk, capsys):
    for number, name in enumerate(("okuri48", "okuri49")):
        write_walk(serve.inbox / f"{name}.trc", seed=number)
    (serve.inbox / "broken.trc").write_text(BROKEN)
    until(lambda: len(serve.takes()) == 2, serve.log.read_text)
    until((serve.inbox / "quarantine" / "broken.trc" / "broken.trc").exists, "not moved")
    assert "Why: " in (serve.inbox / "quarantine" / "broken.trc" / "REASON.txt").read_text("utf-8")
    assert main(["search", str(serve.archive), "okuri48:0-40", "--json"]) == 0
    matches = json.loads(capsys.readouterr().out)["matches"]
    assert matches[0]["take"] == "okuri48"

    def failed():  # it ends a moment after the file has been moved
        named = (run for run in serve.runs(of=["FAILED"]) if run["name"] == "scan the inboxes")
        return next(named, None)

    scan = until(failed, "no scan failed")
    assert (scan["auto_scheduled"], scan["state_name"]) == (True, "Refused")
    assert scan["state"]["message"].startswith("1 of 3 recordings were not taken in: ")
    assert "broken.trc" in scan["state"]["message"]
    logs = {"logs": {"flow_run_id": {"any_": [scan["id"]]}}}

    def said():
        return "was moved to quarantine" in str(serve.ask("logs/filter", logs))

    until(said, "our own lines are not in the log of the run")
    assert "Traceback" not in str(serve.ask("logs/filter", logs))
    ended = {"filter": {"event": {"name": [ENDED]}}}
    until(lambda: serve.ask("events/filter", ended)["events"], "scans do not say that they ended")
    write_walk(serve.inbox / "broken.trc", seed=3)
    until(lambda: "broken" in serve.takes(), "what was mended is not taken in")


@pytest.mark.flow
@pytest.mark.slow
def test_forms_name_only_what_lies_in_the_roots_and_bad_values_start_no_run(serve, tmp_path):
    (tmp_path / "secret.trc").write_text("secret")
    outside = [str(tmp_path / "secret.trc"), "../archive/archive.json"]
    refused = [
        serve.start("ingest", paths=outside),
        serve.start("search", query=f"{tmp_path}/secret.trc:0-9"),
    ]
    good = serve.start("search", query="okuri48:0-40", part="feet")
    for deployment, parameters in (
        ("search", {"query": "okuri48", "top": 0}),
        ("search", {"query": "okuri48", "part": "tail"}),
        ("ingest", {"paths": []}),
        ("gc", {"older_than_hours": 0}),
    ):
        with pytest.raises(urllib.error.HTTPError, match="409"):
            serve.start(deployment, **parameters)
    for run in map(serve.end, refused):
        assert (run["state_type"], run["state_name"]) == ("FAILED", "Refused")
        assert "does not lie in" in run["state"]["message"]
        assert "nothing else is read" in run["state"]["message"]
    assert serve.end(good)["state"]["message"].endswith("matches in 3 takes")
    pool = serve.ask("work_pools/shosa")
    assert pool["base_job_template"]["variables"]["properties"] == {}  # nor the command
    assert pool["concurrency_limit"] is None


@pytest.mark.flow
@pytest.mark.slow
def test_server_worker_and_flow_are_killed_at_once_and_all_goes_on_by_itself(serve, write_walk):
    names = [f"walk{number}" for number in range(12)]
    for number, name in enumerate(names):
        write_walk(serve.inbox / f"{name}.trc", seed=10 + number)
    until(lambda: any("prefect.engine" in each for each in serve.processes().values()), "no run")
    killed = serve.processes()
    assert {"server" in said or "worker" in said for said in killed.values()} >= {True}
    for process in killed:
        os.kill(process, signal.SIGKILL)
    until(lambda: {*names} <= {*serve.takes()}, serve.log.read_text)
    archive = open_archive(serve.archive)
    assert [record.number for record in archive.records() if record.take in names] == [1] * 12
    assert [fault for name in names for fault in verify_take(archive.place, name)] == []

    def none_dead():
        try:
            alive = " ".join(map(str, serve.runs(of=["RUNNING"])))
        except OSError:
            return False
        return all(str(process) not in alive for process in killed)

    until(none_dead, "runs of the dead count as running")
    [automation] = serve.ask("automations/filter", {})
    assert {ENDED, "prefect.flow-run.Refused"} < {*automation["trigger"]["expect"]}
    tag = automation["trigger"]["match_related"]["prefect.resource.id"]
    runs = serve.ask("flow_runs/filter", {"limit": 200})
    assert {"scan the inboxes", f"ingest into {serve.archive}"} <= {each["name"] for each in runs}
    for run in runs:  # also those inside runs; those of others have other tags
        assert tag.removeprefix("prefect.tag.") in run["tags"], run["name"]


@pytest.mark.long
@pytest.mark.flow
@pytest.mark.slow
def test_a_scan_by_hand_beside_the_scheduled_ones_takes_nothing_in_twice(serve, write_walk):
    for number in range(3):
        write_walk(serve.inbox / f"hand{number}.trc", seed=40 + number)
    environment = {**serve.environment, "PREFECT_API_URL": serve.api}
    ended = subprocess.run(
        serve.command("--once", "--settle", "1"), env=environment, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    until(lambda: {f"hand{n}" for n in range(3)} <= {*serve.takes()}, "not taken in")
    records = open_archive(serve.archive).records()
    assert {record.number for record in records if record.take.startswith("hand")} == {1}


@pytest.mark.flow
@pytest.mark.slow
def test_a_port_that_is_taken_and_an_archive_that_is_served_are_told_with_what_to_do(
    serve, tmp_path
):
    def end(*command):
        environment = {**serve.environment, "PREFECT_HOME": str(tmp_path / "home")}
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert (done.returncode, len(done.stderr.splitlines())) == (4, 1), done.stderr
        return done.stderr

    said = end(*serve.command("--port", str(free_port())))
    assert f"{serve.archive} is being served by process {serve.process.pid} on " in said
    assert "end that one first, or work for it with --join" in said
    other = [*serve.command("--port", str(serve.port))]
    other[other.index(str(serve.archive))] = str(tmp_path / "archive")
    said = end(*other)
    assert f"cannot listen on 127.0.0.1:{serve.port}" in said
    assert f"set PREFECT_API_URL={serve.api}; otherwise give another --port" in said


@pytest.mark.flow
@pytest.mark.slow
def test_a_signal_ends_all_of_it(serve):
    assert serve.process.poll() is None, serve.log.read_text()
    serve.process.terminate()
    assert serve.process.wait(HANGING_S) == 0
    assert serve.processes() == {}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--every", "1"], "--every 1 should be seconds, 5 or more"),
        (["--every", "nan"], "--every nan should be seconds"),
        (["--settle", "-1"], "--settle -1 should be seconds, 0 or more"),
        (["--limit", "0"], "--limit 0 should be a number of runs"),
        (["--port", "70000"], "--port 70000 should be"),
        (["--cron", "every day"], "--cron 'every day' should have five fields"),
        (["--join", "host:4200"], "--join host:4200 should read http://HOST:PORT/api"),
        (["--root", "/absent"], "--root /absent is no folder"),
    ],
)
def test_options_that_mean_nothing_are_wrong_use(tmp_path, capsys, options, said):
    (tmp_path / "inbox").mkdir()
    command = ["serve", str(tmp_path / "archive"), "--inbox", str(tmp_path / "inbox")]
    assert main([*command, *options]) == 2
    assert said in capsys.readouterr().err


def test_a_scan_of_nothing_is_wrong_use(tmp_path, capsys):
    assert main(["serve", str(tmp_path / "archive"), "--once"]) == 2
    assert "there is nothing to scan; give an --inbox" in capsys.readouterr().err


def test_an_inbox_that_cannot_be_used_is_bad_input(tmp_path, capsys):
    archive = str(tmp_path / "archive")
    assert main(["serve", archive, "--inbox", str(tmp_path / "absent")]) == 3
    assert "is not there; make the folder" in capsys.readouterr().err
    assert main(["serve", archive, "--inbox", archive]) == 3
    assert "is the archive itself" in capsys.readouterr().err


def test_a_server_to_be_joined_has_to_answer(tmp_path, capsys):
    url = f"http://127.0.0.1:{free_port()}/api"
    assert main(["serve", str(tmp_path / "archive"), "--join", url]) == 4
    assert f"no Prefect server answers at {url}; check that" in capsys.readouterr().err


def test_who_lost_the_archive_to_another_machine_ends_and_says_so():
    environment = {"PREFECT_HOME": "/nowhere"}
    options = {"own": False, "joins": False}
    url, lost = "http://127.0.0.1:1/api", lambda: False
    supervisor = serving._Supervisor(environment, url, "127.0.0.1", 1, 1, lost, **options)
    with pytest.raises(ServingError, match="another took the archive over"):
        supervisor._watch()


def test_a_script_of_prefect_beside_a_module_of_our_name_finds_ours(tmp_path, monkeypatch):
    """When a run crashed, a worker starts one, which lies beside Prefect's own `storage`."""
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    (tmp_path / "storage.py").write_text("")
    (tmp_path / "script.py").write_text("import flows.service.served, storage.archive")
    served = Served(str(tmp_path / "archive"))
    environment = environment_of(served, "http://127.0.0.1:1/api", "::1", 1, own=False)
    script = [sys.executable, str(tmp_path / "script.py")]
    done = subprocess.run(script, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_home_that_cannot_be_written_is_told_at_once(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "file" / "home"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    assert main(["serve", str(tmp_path / "archive"), "--port", str(free_port())]) == 4
    assert "cannot be written to (Not a directory); set PREFECT_HOME" in capsys.readouterr().err


def test_a_scan_with_nothing_new_needs_no_prefect(tmp_path):
    (tmp_path / "inbox").mkdir()
    program = (
        "import sys; from flows.command.main import main; "
        f"code = main(['serve', {str(tmp_path / 'archive')!r}, '--inbox', "
        f"{str(tmp_path / 'inbox')!r}, '--once']); assert 'prefect' not in sys.modules; "
        "sys.exit(code)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True
    )
    assert (ended.returncode, "nothing new" in ended.stderr) == (0, True), ended.stderr
