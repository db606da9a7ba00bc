"""Keep an archive served: a Prefect server, a worker, and what starts them again when they die.

The supervisor has no logic of its own and imports no Prefect: it starts the server (where none
answers yet), has `flows.deploying` say what can be run, starts a worker, and watches them. What
the server remembers is in a folder of its own; what matters is in the archive.
"""

import ctypes
import hashlib
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from flows.processes import served_processes
from flows.served import ENDED, POOL, VARIABLE, Served, ServingError, write_served
from flows.server import check_home, check_version, is_healthy

logger = logging.getLogger(__name__)

_START_S = 180.0  # a server on a busy machine; 15 s is usual
_STOP_S = 30.0  # what a worker gets to end its runs, then they are killed
_LOOK_S = 1.0  # between two looks at the children
_HEALTH_S, _MISSED = 10.0, 3  # between two questions to the server, and how many go unanswered
_STEADY_S = 60.0  # a child that ran for so long did not die of its start
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 60.0  # before a child that died is started again
_HEARTBEAT_S = 30  # the least that Prefect allows
_RUNS_KEPT_DAYS, _EVENTS_KEPT_DAYS = 30, 2  # a scan a minute writes 76 kB, most of it events
_BEATS_KEPT_S = 3600.0
SOON_OLD = (
    "flow-run.heartbeat", "flow-run.Scheduled", "flow-run.Late", "flow-run.Pending",
    "flow-run.Submitting", "flow-run.Running", "flow-run.Completed", "task-run.Pending",
    "task-run.Running", "task-run.Completed", "task-run.Cached", "worker.submitted-flow-run",
    "worker.executed-flow-run", "artifact.created", "artifact.updated", "automation.triggered",
    "automation.action.triggered", "automation.action.executed", "automation.action.failed",
)  # fmt: skip
_LEASE_S = 60.0  # how long a dead run holds the slot of a deployment


def serve(
    served: Served,
    *,
    host: str,
    port: int,
    join: str | None = None,
    is_held: Callable[[], bool] = lambda: True,
) -> None:
    """Serve an archive until a signal comes.

    Parameters
    ----------
    served
        The archive, its inboxes and how they are scanned.
    host, port
        Where the server listens, if one has to be started.
    join
        The API of a server that another machine runs: then this machine only works.
    is_held
        Says whether the archive is still this machine's to serve.

    Raises
    ------
    ServingError
        If the port is taken, the server to be joined does not answer, something does not start, or
        the archive came to be served by another.
    ServerError
        If the server is of another version, or its folder cannot be written to.
    """
    url = join or os.environ.get("PREFECT_API_URL") or ""
    own = not (url and is_healthy(url))
    if own and join:
        raise ServingError(
            f"no Prefect server answers at {join}; check that `shosa serve` runs there, listens on "
            "more than loopback (--host), and that the URL ends in /api"
        )
    if not own:
        check_version(url)
    else:
        if url:
            logger.warning("no Prefect server answers at %s; one is started here", url)
        _check_free(host, port)
        url = f"http://{_to_call(host)}:{port}/api"
    environment = {**os.environ, **_environment(served, url, host, port, own=own)}
    _Supervisor(
        environment, url, host, port, served.limit, is_held, own=own, joins=bool(join)
    ).run()


class _Supervisor:
    """Two children, and what keeps them alive."""

    def __init__(
        self,
        environment: dict[str, str],
        url: str,
        host: str,
        port: int,
        limit: int,
        is_held: Callable[[], bool],
        *,
        own: bool,
        joins: bool,
    ) -> None:
        self.environment, self.url, self.joins = environment, url, joins
        self.is_held = is_held
        self.stopping = False
        prefect = [sys.executable, "-m", "prefect"]
        self.server = (
            _Child("server", [*prefect, "server", "start", "--host", host, "--port", str(port)])
            if own
            else None
        )
        name = f"{socket.gethostname()}-{os.getpid()}"
        worker = [*prefect, "worker", "start", "--pool", POOL, "--type", "process"]
        worker += ["--no-create-pool-if-not-found"]  # it would let a form name a command
        self.worker = _Child("worker", [*worker, "--limit", str(limit), "--name", name])

    def run(self) -> None:
        before = {each: signal.signal(each, self._stop) for each in _SIGNALS}
        try:
            self._start()
            if not self.stopping:
                logger.info("serving: %s", self.url.removesuffix("/api"))
            self._watch()
        finally:
            self.worker.stop()  # while the server is there to hear of it
            _end_left_runs(self.environment)
            if self.server:
                self.server.stop()
            for each, handler in before.items():
                signal.signal(each, handler)

    def _stop(self, *_: Any) -> None:
        self.stopping = True

    def _start(self) -> None:
        """Start the server, and tell it what can be run; again where it was killed meanwhile."""
        while not self.stopping:
            self._start_server()
            try:
                self._tell("join" if self.joins else "deploy")
                return
            except ServingError:
                if self.server is None or is_healthy(self.url):
                    raise

    def _start_server(self) -> None:
        """Start the server where it does not run, and wait until it answers."""
        if self.server is None:
            return
        until = time.monotonic() + _START_S
        while not self.stopping and not is_healthy(self.url):
            if self.server.is_dead() and (self.server.code() or 0) > 0:  # not killed by a signal
                raise ServingError(f"the Prefect server does not start: {self.server.last_words()}")
            if time.monotonic() > until:
                raise ServingError(f"the Prefect server does not answer within {_START_S:.0f} s")
            self.server.keep(self.environment)
            time.sleep(_LOOK_S / 4)

    def _tell(self, action: str) -> None:
        """Have the server told what can be run ("deploy"), or only which runs died ("join")."""
        if self.stopping:
            return
        child = _Child("deployments", [sys.executable, "-m", "flows.deploying", action])
        child.start(self.environment)
        while not child.is_dead():
            if self.stopping:
                child.stop()
                return
            time.sleep(_LOOK_S / 4)
        if child.code():
            raise ServingError(f"the server cannot be told what can be run: {child.last_words()}")

    def _tell_dead(self) -> None:
        """Have the server told which runs died with the worker, if it can be told."""
        try:
            self._tell("join")
        except ServingError as error:
            logger.warning("%s", error)

    def _watch(self) -> None:
        """Start what died again, and the worker when the server had been away."""
        asked, away, missed = time.monotonic(), False, 0
        while not self.stopping:
            if not self.is_held():
                raise ServingError(
                    "this machine stood still for so long that another took the archive over; it "
                    "is served there"
                )
            if self.server and self.server.keep(self.environment):
                away = True
            if self.worker.keep(self.environment) and is_healthy(self.url):
                self._tell_dead()
            if time.monotonic() - asked >= _HEALTH_S:
                asked = time.monotonic()
                answers = is_healthy(self.url)
                missed = 0 if answers else missed + 1
                if answers and away:
                    logger.warning("the Prefect server is back; the worker is started again")
                    self.worker.kill()
                    self._tell_dead()
                elif missed == _MISSED:
                    logger.warning("the Prefect server at %s does not answer", self.url)
                # a busy server that is late once is not away
                away = not answers and (away or missed >= _MISSED)
            time.sleep(_LOOK_S)


_SIGNALS = (signal.SIGTERM, signal.SIGINT)


class _Child:
    """A process that is started again when it dies."""

    def __init__(self, name: str, command: list[str]) -> None:
        self.name, self.command = name, command
        self.process: subprocess.Popen[bytes] | None = None
        self.started = self.due = 0.0
        self.pause_s = _FIRST_PAUSE_S
        self.log: Path | None = None

    def start(self, environment: Mapping[str, str]) -> None:
        # a session of its own: Ctrl-C in a terminal is for the supervisor, which ends the rest
        self.log = Path(environment["PREFECT_HOME"]) / f"{self.name}.log"
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self.command,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
        self.started = time.monotonic()

    def is_dead(self) -> bool:
        return self.process is None or self.process.poll() is not None

    def code(self) -> int | None:
        return self.process.returncode if self.process else None

    def keep(self, environment: Mapping[str, str]) -> bool:
        """Start it if it is dead; the more often it dies, the later. Say whether it had died."""
        now = time.monotonic()
        if not self.is_dead():
            return False
        died = self.process is not None
        if self.process is not None:
            steady = now - self.started > _STEADY_S
            self.pause_s = _FIRST_PAUSE_S if steady else self.pause_s
            logger.warning(
                "the %s ended (%s); it is started again in %.0f s: %s",
                *(self.name, self.code(), self.pause_s, self.last_words()),
            )
            self.process, self.due = None, now + self.pause_s
            self.pause_s = min(2 * self.pause_s, _LONGEST_PAUSE_S)
        if now >= self.due:
            self.start(environment)
        return died

    def kill(self) -> None:
        """End the process, but not what it runs; it is started anew at the next look."""
        if self.process is not None and not self.is_dead():
            self.process.kill()
            self.process.wait()
        self.process, self.due = None, 0.0

    def stop(self) -> None:
        """End the process and all that it runs."""
        if self.process is None:
            return
        group = self.process.pid
        if self.process.poll() is None:
            self.process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_STOP_S)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)  # what it left behind
        self.process.wait()

    def last_words(self) -> str:
        """Return the last line that says something of its log, and where the log is."""
        if self.log is None:
            return "it was not started"
        lines = self.log.read_bytes()[-20_000:].decode(errors="replace").splitlines()
        said = [line.strip() for line in lines if any(each.isalpha() for each in line)]
        return f"{said[-1] if said else 'it said nothing'} (all of it is in {self.log})"


def _end_left_runs(environment: Mapping[str, str]) -> None:
    """End the runs that a worker left behind when it was killed."""
    for each in served_processes(environment["PREFECT_HOME"]):
        if each.run and each.environment[VARIABLE] == environment[VARIABLE]:
            with suppress(ProcessLookupError):
                os.kill(each.number, signal.SIGKILL)


def _die_with_parent() -> None:
    """In a child before it begins: end when the supervisor is killed (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # 1: PR_SET_PDEATHSIG


def _environment(served: Served, url: str, host: str, port: int, *, own: bool) -> dict[str, str]:
    """Return the settings of the children; what the user has set stays."""
    settings = {
        "PREFECT_HOME": str(_home(served.archive)),
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_SERVICES_DB_VACUUM_ENABLED": "events,flow_runs",
        "PREFECT_SERVER_SERVICES_DB_VACUUM_RETENTION_PERIOD": str(_RUNS_KEPT_DAYS * 86400),
        "PREFECT_SERVER_EVENTS_RETENTION_PERIOD": f"P{_EVENTS_KEPT_DAYS}D",
        # 7 kB each, most of what a scan and a take cost; the states and artifacts themselves stay
        "PREFECT_SERVER_SERVICES_DB_VACUUM_EVENT_RETENTION_OVERRIDES": json.dumps(
            {ENDED: _BEATS_KEPT_S, **{f"prefect.{each}": _BEATS_KEPT_S for each in SOON_OLD}}
        ),
        # without these, a run that died holds the deployment's slot for ever
        "PREFECT_SERVER_CONCURRENCY_LEASE_STORAGE": (
            "prefect.server.concurrency.lease_storage.filesystem"
        ),
        "PREFECT_SERVER_CONCURRENCY_INITIAL_DEPLOYMENT_LEASE_DURATION": str(_LEASE_S),
        # SQLite lets one write at a time; who waits for 10 s is refused otherwise
        "PREFECT_SERVER_DATABASE_TIMEOUT": "60",
        # Prefect runs a script of its own beside a module `storage`, which would hide ours
        "PYTHONSAFEPATH": "1",
        "PREFECT_FLOWS_HEARTBEAT_FREQUENCY": str(_HEARTBEAT_S),
        "PREFECT_RESULTS_DEFAULT_SERIALIZER": "json",  # reading a pickle runs what is in it
        "PREFECT_LOGGING_EXTRA_LOGGERS": "flows,tasks,storage",
        "PREFECT_LOGGING_TO_API_WHEN_MISSING_FLOW": "ignore",  # what is said outside of a run
        "PREFECT_CLI_PROMPT": "false",
    }
    if own:
        page = f"http://{_to_call(host)}:{port}"
        settings |= {
            # another page in the same browser may not ask for runs
            "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"{page},http://localhost:{port}",
            "PREFECT_SERVER_UI_API_URL": "/api",  # by whatever name the page was reached
        }
    kept = {name: value for name, value in settings.items() if name not in os.environ}
    path = [str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH", "")]
    return {
        **kept,
        VARIABLE: write_served(served),
        "PREFECT_API_URL": url,
        "PYTHONPATH": os.pathsep.join(filter(None, path)),
    }


def _home(archive: str) -> Path:
    """Return the folder in which the server of an archive keeps what it remembers, made."""
    given = os.environ.get("PREFECT_HOME")
    states = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    key = hashlib.sha256(archive.encode()).hexdigest()[:12]
    home = Path(given or f"{states}/shosa/{key}").expanduser().absolute()
    check_home(home)
    return home


def _check_free(host: str, port: int) -> None:
    """Refuse a port that somebody listens on."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(family) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((host, port))
    except OSError as error:
        there = is_healthy(f"http://{_to_call(host)}:{port}/api")
        advice = (
            f"a Prefect server answers there: if it is to be used, set PREFECT_API_URL="
            f"http://{_to_call(host)}:{port}/api; otherwise give another --port"
            if there
            else "give another --port or --host"
        )
        raise ServingError(f"cannot listen on {host}:{port} ({error.strerror}); {advice}") from None


def _to_call(host: str) -> str:
    """Return the address by which this machine calls a server that listens on `host`."""
    if host in ("0.0.0.0", "::"):
        return "127.0.0.1"
    return f"[{host}]" if ":" in host else host
