"""The sub-command `view`, which opens an archive in a browser."""

import argparse
import os
from typing import Any

from flows.command import printing
from flows.command.options import UsageError
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
    open_archive(options.archive)  # before the pages are loaded, which takes a second or two
    from viewer.serving import quiet_libraries, serve_viewer

    quiet_libraries()

    def tell(address: str) -> None:
        printing.print_line(address)
        printing.say(f"showing {options.archive}; Ctrl+C ends it")

    serve_viewer(
        options.archive, host=options.host, port=options.port, runs_url=runs_url(),
        open_browser=not options.no_browser, tell=tell,
    )  # fmt: skip
    return 0


def runs_url() -> str:
    """Return where Prefect's dashboard is, as its own variables say."""
    api = os.environ.get("PREFECT_API_URL", "http://127.0.0.1:4200/api")
    return os.environ.get("PREFECT_UI_URL") or api.removesuffix("/").removesuffix("/api")
