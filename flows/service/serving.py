"""Keep an archive served: a Prefect server, a worker, and what starts them again when they die.

The supervisor has no logic of its own and imports no Prefect: it starts the server (where none
answers yet), has `flows.service.deploying` say what can be run, starts a worker, and watches them.
What the server remembers is in a folder of its own; what matters is in the archive.
"""

import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from flows.server import check_version, is_healthy
from flows.service.children import Child
from flows.service.environment import environment_of, to_call
from flows.service.processes import served_processes
from flows.service.served import POOL, VARIABLE, Served, ServingError

logger = logging.getLogger(__name__)

_START_S = 180.0  # a server on a busy machine; 15 s is usual
_LOOK_S = 1.0  # between two looks at the children
_HEALTH_S, _MISSED = 10.0, 3  # between two questions to the server, and how many go unanswered
_SIGNALS = (signal.SIGTERM, signal.SIGINT)


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
        url = f"http://{to_call(host)}:{port}/api"
    environment = {**os.environ, **environment_of(served, url, host, port, own=own)}
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
            Child("server", [*prefect, "server", "start", "--host", host, "--port", str(port)])
            if own
            else None
        )
        name = f"{socket.gethostname()}-{os.getpid()}"
        worker = [*prefect, "worker", "start", "--pool", POOL, "--type", "process"]
        worker += ["--no-create-pool-if-not-found"]  # it would let a form name a command
        self.worker = Child("worker", [*worker, "--limit", str(limit), "--name", name])

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
        child = Child("deployments", [sys.executable, "-m", "flows.service.deploying", action])
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


def _end_left_runs(environment: Mapping[str, str]) -> None:
    """End the runs that a worker left behind when it was killed."""
    for each in served_processes(environment["PREFECT_HOME"]):
        if each.run and each.environment[VARIABLE] == environment[VARIABLE]:
            with suppress(ProcessLookupError):
                os.kill(each.number, signal.SIGKILL)


def _check_free(host: str, port: int) -> None:
    """Refuse a port that somebody listens on."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(family) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((host, port))
    except OSError as error:
        there = is_healthy(f"http://{to_call(host)}:{port}/api")
        advice = (
            f"a Prefect server answers there: if it is to be used, set PREFECT_API_URL="
            f"http://{to_call(host)}:{port}/api; otherwise give another --port"
            if there
            else "give another --port or --host"
        )
        raise ServingError(f"cannot listen on {host}:{port} ({error.strerror}); {advice}") from None
