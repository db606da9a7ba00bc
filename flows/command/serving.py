"""The command `serve`: what its options mean, and one scan without a server."""

import argparse
import math
import os
import time
from pathlib import Path
from urllib.parse import urlsplit

from flows.command import printing
from flows.command.exits import DONE, RUN_FAILED
from flows.command.options import UsageError, check_environment
from flows.links import VIEWER_URL, is_web_address
from flows.service.served import Served, ServingError
from flows.service.serving import serve
from storage import create_archive
from storage.inbox.listing import open_inbox
from storage.inbox.lock import BusyError, serving
from storage.inbox.memory import look_now
from storage.roots import is_url

_LEAST_S, _MOST_S = 5.0, 24 * 3600.0 * 366
"""How often a scan may be scheduled [s]. Chosen: a scan takes seconds; a year."""
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_WAIT_S = 1.0  # added to the settling time before the second look of --once


def add_serve_options(serve: argparse.ArgumentParser) -> None:
    """Add the options of `serve`."""
    serve.add_argument("archive", metavar="ARCHIVE", help="a directory or s3://bucket/prefix")
    serve.add_argument(
        "--inbox",
        action="append",
        default=[],
        metavar="DIR",
        help="what is dropped here is taken in; a folder or s3://bucket/prefix; may be repeated",
    )
    serve.add_argument(
        "--root",
        action="append",
        default=[],
        metavar="DIR",
        help="forms and links may also name what is below here; may be repeated",
    )
    when = serve.add_mutually_exclusive_group()
    when.add_argument(
        "--every", type=float, metavar="SECONDS", help="between two scans (default 60)"
    )
    when.add_argument("--cron", metavar="CRON", help='when to scan, such as "0 3 * * *"')
    serve.add_argument(
        "--settle",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="how long a recording is unchanged before it is read (default 60)",
    )
    serve.add_argument(
        "--limit", type=int, default=2, metavar="N", help="runs at once here (default 2)"
    )
    serve.add_argument("--host", default="127.0.0.1", help="where the dashboard listens")
    serve.add_argument("--port", type=int, default=4200, help="of the dashboard (default 4200)")
    serve.add_argument(
        "--join", metavar="URL", help="work for the server of another machine, http://HOST:PORT/api"
    )
    serve.add_argument(
        "--viewer",
        metavar="URL",
        help="where `shosa view` answers: takes and matches in the dashboard link to it",
    )
    serve.add_argument(
        "--once", action="store_true", help="scan the inboxes once, without a server, and end"
    )


def run_serve(options: argparse.Namespace) -> int:
    """Serve an archive, or scan its inboxes once; return the exit code, 4 where not all went in.

    Raises
    ------
    UsageError
        If options mean nothing, or not together.
    InputError, PlaceError
        If the archive or an inbox cannot be used.
    """
    _check(options)
    check_environment()
    if options.viewer is not None:
        if not is_web_address(options.viewer):
            raise UsageError(f"--viewer {options.viewer} should read http://HOST:PORT")
        os.environ[VIEWER_URL] = options.viewer
    archive = create_archive(options.archive).location
    inboxes = list(dict.fromkeys(open_inbox(each, archive).location for each in options.inbox))
    roots = [
        each if is_url(each) else str(Path(each).expanduser().resolve()) for each in options.root
    ]
    for root in roots:
        if not is_url(root) and not Path(root).is_dir():
            raise UsageError(f"--root {root} is no folder")
    served = Served(
        archive=archive,
        inboxes=inboxes,
        roots=[*inboxes, *roots],
        settle_s=options.settle,
        every_s=None if options.cron else options.every or 60.0,
        cron=options.cron,
        limit=options.limit,
    )
    if options.once:
        return _scan_once(served)
    if options.host not in _LOOPBACK and not os.environ.get("PREFECT_SERVER_API_AUTH_STRING"):
        printing.say(
            f"note: whoever reaches {options.host}:{options.port} can run programs as this user; "
            "let a firewall or PREFECT_SERVER_API_AUTH_STRING stand before it (docs/operations.md)"
        )
    if options.join:
        serve(served, host=options.host, port=options.port, join=options.join)
        return DONE
    try:
        with serving(create_archive(archive)) as is_held:
            serve(served, host=options.host, port=options.port, is_held=is_held)
    except BusyError as error:
        raise ServingError(
            f"{error}; end that one first, or work for it with --join and the URL of its API"
        ) from error
    return DONE


def _check(options: argparse.Namespace) -> None:
    """Refuse what means nothing, before anything is started."""
    if not options.inbox and (options.once or options.every or options.cron):
        raise UsageError("there is nothing to scan; give an --inbox")
    if options.every is not None and not _LEAST_S <= options.every <= _MOST_S:
        raise UsageError(f"--every {options.every:g} should be seconds, {_LEAST_S:g} or more")
    if not 0 <= options.settle < math.inf:
        raise UsageError(f"--settle {options.settle:g} should be seconds, 0 or more")
    if options.limit < 1:
        raise UsageError(f"--limit {options.limit} should be a number of runs, 1 or more")
    if not 0 < options.port < 1 << 16:
        raise UsageError(f"--port {options.port} should be a number between 1 and 65535")
    if options.join is not None:
        parts = urlsplit(options.join)
        if parts.scheme not in ("http", "https") or not parts.path.rstrip("/").endswith("/api"):
            raise UsageError(f"--join {options.join} should read http://HOST:PORT/api")
    if options.cron is not None:
        from prefect.client.schemas.schedules import CronSchedule

        try:
            CronSchedule(cron=options.cron)
        except ValueError:
            raise UsageError(
                f'--cron {options.cron!r} should have five fields, such as "0 3 * * *": minute, '
                "hour, day, month, day of the week"
            ) from None


def _scan_once(served: Served) -> int:
    """Scan each inbox; Prefect is started only where something is to be taken in."""
    place = create_archive(served.archive).place
    boxes = [open_inbox(each, served.archive) for each in served.inboxes]
    looks = [look_now(place, box, served.settle_s) for box in boxes]
    if any(seen.state == "waiting" for known, _ in looks for seen in known.values()):
        time.sleep(served.settle_s + _WAIT_S)
        looks = [look_now(place, box, served.settle_s) for box in boxes]
    good = True
    for box, (known, ready) in zip(boxes, looks, strict=True):
        if not ready and all(seen.state != "started" for seen in known.values()):
            printing.say(f"{box.location}: nothing new")
            continue
        from flows.server import check_server
        from flows.service.inbox import scan_inbox

        check_server()
        state = scan_inbox(
            served.archive, box.location, served.settle_s, served.roots, return_state=True
        )
        printing.say(f"{box.location}: {state.message}")
        good = good and state.is_completed()
    return DONE if good else RUN_FAILED
