"""The sub-command `view`, which opens an archive in a browser."""

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from flows.command import printing
from flows.command.exits import DONE
from flows.command.options import (
    UsageError,
    add_search_options,
    query_settings,
    search_settings,
    values_refused,
)
from flows.links import artifact_key, is_web_address
from storage import open_archive

_LARGEST_PORT = 65535


def add_view(commands: Any, make: Any) -> None:
    """Add what `shosa view` understands; `make` adds a sub-command."""
    view = make(commands, "view", view_archive, "see, search and correct an archive in a browser")
    view.add_argument("archive", metavar="ARCHIVE", help="a directory or s3://bucket/prefix")
    view.add_argument("--port", type=int, default=8080, metavar="N", help="default 8080; 0: any")
    view.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS",
        help="who can reach it: by default only this machine; 0.0.0.0 lets the whole network in",
    )  # fmt: skip
    view.add_argument(
        "--runs",
        metavar="URL",
        help="where the dashboard of `shosa serve` is, for links; as PREFECT_API_URL says",
    )
    view.add_argument("--no-browser", action="store_true", help="only print the address")


def view_archive(options: argparse.Namespace) -> int:
    """Run `shosa view` until it is interrupted.

    Raises
    ------
    UsageError, InputError, ArchiveError, PlaceError
        If the port is no port, there is no archive, or nothing can listen there.
    """
    if not 0 <= options.port <= _LARGEST_PORT:
        raise UsageError(f"--port {options.port} should be 0 to {_LARGEST_PORT}, such as 8080")
    if options.runs and not is_web_address(options.runs):
        raise UsageError(
            f"--runs {options.runs} should be an address, such as http://127.0.0.1:4200"
        )
    open_archive(options.archive)  # before the pages are loaded, which takes a second or two
    from viewer.serving import quiet_libraries, serve_viewer

    quiet_libraries()
    runs = options.runs or runs_url()

    def digitize(capture: str, said: Path) -> subprocess.Popen[bytes]:
        with said.open("wb") as into:
            return subprocess.Popen(
                [sys.executable, "-m", "flows.command.main", "ingest", options.archive, capture],
                stdout=subprocess.DEVNULL, stderr=into, stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl+C ends the viewer, and not this
            )  # fmt: skip

    def tell(address: str) -> None:
        printing.print_line(address)
        printing.say(f"showing {options.archive}; Ctrl+C ends it")

    signal.signal(signal.SIGTERM, _end)
    serve_viewer(
        options.archive, host=options.host, port=options.port, runs_url=runs,
        run_address=lambda take: run_address(runs, take),
        digitize=digitize, open_browser=not options.no_browser, tell=tell,
    )  # fmt: skip
    return DONE


def _end(*_: Any) -> None:
    """End as if the viewer had returned: what visitors uploaded is removed."""
    raise SystemExit(0)


def add_report(commands: Any, make: Any) -> None:
    """Add what `shosa report` understands; `make` adds a sub-command."""
    text = "write a search as one HTML file that plays query and matches without archive or network"
    report = make(commands, "report", report_search, text)
    report.add_argument("archive", metavar="ARCHIVE")
    report.add_argument("query", metavar="QUERY", help="TAKE[:START-END] or FILE[:START-END]")
    report.add_argument("file", metavar="FILE.html")
    add_search_options(report)
    report.set_defaults(steps="slope")


def report_search(options: argparse.Namespace) -> int:
    """Run `shosa report`.

    Raises
    ------
    UsageError, InputError, ArchiveError, UnknownNameError, PlaceError
        As `shosa search`, or if the file is not called .html or cannot be written.
    """
    settings, imported = search_settings(options), query_settings(options)
    if Path(options.file).suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{options.file} should end in .html: the report is one page")
    from storage.formats import MOTION_SUFFIXES
    from tasks.retrieval.answering import parse_query
    from viewer.answers import find_others
    from viewer.holdings import Holdings, motion_of_file
    from viewer.report import write_report

    name, clip = parse_query(options.query)
    holdings = Holdings(options.archive, Path())
    if Path(name).suffix.lower() in MOTION_SUFFIXES:
        motion = motion_of_file(Path(name), "query", Path(name).name, imported)
    else:
        motion = holdings.motion(name)
    clip = clip or (0, motion.frames - 1)
    with values_refused():
        answer = find_others(
            holdings, motion, clip, settings, takes=options.takes, imported=imported
        )
    for take, reason in answer.skipped.items():
        printing.say(f"not compared: {take}: {reason}")
    printing.say(write_report(holdings, answer, motion, options.file))
    return DONE


def runs_url() -> str:
    """Return where Prefect's dashboard is, as its own variables say."""
    api = os.environ.get("PREFECT_API_URL", "http://127.0.0.1:4200/api")
    return os.environ.get("PREFECT_UI_URL") or api.removesuffix("/").removesuffix("/api")


def run_address(runs: str, take: str) -> str:
    """Return where the dashboard shows what was made of a take: its page, which its runs write."""
    return f"{runs.rstrip('/')}/artifacts/key/{artifact_key('digitized', take)}"
