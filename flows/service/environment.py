"""What server and worker are told by their environment: the settings of Prefect."""

import hashlib
import json
import os
from pathlib import Path

from flows.server import check_home
from flows.service.served import ENDED, VARIABLE, Served, write_served

_HEARTBEAT_S = 30  # the least that Prefect allows
_RUNS_KEPT_DAYS, _EVENTS_KEPT_DAYS = 30, 2  # a scan a minute writes 76 kB, most of it events
_BEATS_KEPT_S = 3600.0  # events that tell what states, runs and artifacts say themselves
SOON_OLD = (
    "flow-run.heartbeat", "flow-run.Scheduled", "flow-run.Late", "flow-run.Pending",
    "flow-run.Submitting", "flow-run.Running", "flow-run.Completed", "task-run.Pending",
    "task-run.Running", "task-run.Completed", "task-run.Cached", "worker.submitted-flow-run",
    "worker.executed-flow-run", "artifact.created", "artifact.updated", "automation.triggered",
    "automation.action.triggered", "automation.action.executed", "automation.action.failed",
)  # fmt: skip
"""The events that are kept for `_BEATS_KEPT_S` only, as Prefect names them after `prefect.`."""
_LEASE_S = 60.0  # how long a dead run holds the slot of a deployment


def environment_of(served: Served, url: str, host: str, port: int, *, own: bool) -> dict[str, str]:
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
        page = f"http://{to_call(host)}:{port}"
        settings |= {
            # another page in the same browser may not ask for runs
            "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"{page},http://localhost:{port}",
            "PREFECT_SERVER_UI_API_URL": "/api",  # by whatever name the page was reached
        }
    kept = {name: value for name, value in settings.items() if name not in os.environ}
    path = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
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


def to_call(host: str) -> str:
    """Return the address by which this machine calls a server that listens on `host`."""
    if host in ("0.0.0.0", "::"):
        return "127.0.0.1"
    return f"[{host}]" if ":" in host else host
