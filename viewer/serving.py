"""Serve the pages of one archive to browsers on this machine, until interrupted."""

import asyncio
import contextlib
import logging
import os
import socket
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path

import numpy as np
import uvicorn
from fastapi import FastAPI, Request
from fastapi.staticfiles import StaticFiles
from nicegui import ui

from storage.errors import PlaceError
from storage.schema import JOINTS
from tasks.retrieval.normalization import INDEX_RATE_HZ, ROWS
from tasks.retrieval.searching import Query, search_takes
from tasks.retrieval.segments import PackedTake
from viewer.addresses.files import add_files
from viewer.addresses.frames import add_data
from viewer.addresses.pictures import add_pictures
from viewer.digitizing import Digitizations, Starter
from viewer.guard import guard
from viewer.holdings import Holdings
from viewer.pages.body import body_page
from viewer.pages.browse import browse_page
from viewer.pages.search import search_page
from viewer.pages.shell import Site

_LOOK = Path(__file__).parent / "static"
_FORGET_S = 10.0
"""How long a page that was left is kept, in case its connection comes back [s]."""


def serve_viewer(
    location: str,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    runs_url: str,
    run_address: Callable[[str], str],
    digitize: Starter,
    open_browser: bool = True,
    tell: Callable[[str], None],
) -> None:
    """Serve the viewer of the archive at `location` until interrupted.

    Parameters
    ----------
    host
        By default only this machine can reach it.
    runs_url
        Where Prefect's dashboard is, for a link.
    run_address
        Returns where the runs of a take are told there.
    digitize
        Starts digitizing a capture into this archive, when a page asks for it.
    tell
        Called with the address, once pages can be opened.

    Raises
    ------
    InputError, ArchiveError
        If there is no archive, or it cannot be read.
    PlaceError
        If the port is taken, or the host is not this machine's.
    """
    with tempfile.TemporaryDirectory(prefix="shosa-view-") as uploads:
        holdings = Holdings(location, Path(uploads))
        with contextlib.closing(_listen(host, port)) as listening:
            bound = listening.getsockname()[1]
            shown = "127.0.0.1" if host in ("0.0.0.0", "") else host
            address = f"http://[{shown}]:{bound}/" if ":" in shown else f"http://{shown}:{bound}/"
            work = Digitizations(digitize, Path(uploads))
            app = make_app(Site(holdings, runs_url, run_address), work)
            server = uvicorn.Server(
                uvicorn.Config(
                    guard(app, host), log_level="warning", access_log=False,
                    timeout_graceful_shutdown=2, lifespan="on",
                )
            )  # fmt: skip
            opening = threading.Thread(
                target=_tell_when_ready,
                args=(server, address, tell, webbrowser.open if open_browser else None),
                daemon=True,
            )
            opening.start()
            threading.Thread(target=warm_up, args=(holdings,), daemon=True).start()
            server.run(sockets=[listening])


def make_app(site: Site, work: Digitizations) -> FastAPI:
    """Return the app with all pages and the addresses that they get frames from."""
    app = FastAPI(openapi_url=None)
    add_data(app, site.holdings)
    add_files(app, site.holdings, work)
    add_pictures(app, site.holdings)
    app.mount("/look", StaticFiles(directory=_LOOK), name="look")

    @ui.page("/")
    async def search(request: Request) -> None:
        await search_page(site, request)

    @ui.page("/browse")
    async def browse(request: Request) -> None:
        await browse_page(site, request)

    @ui.page("/body")
    async def body(request: Request) -> None:
        await body_page(site, request)

    ui.run_with(
        app, title="shosa", dark=None, tailwind=False, reconnect_timeout=_FORGET_S,
        show_welcome_message=False, gzip_middleware_factory=None,
    )  # fmt: skip
    return app


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens; raises a PlaceError that says why not."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(128)
    except (OSError, OverflowError) as error:
        listening.close()
        if isinstance(error, OSError) and error.errno in (98, 48, 10048):
            said = f"port {port} of {host} is taken, perhaps by another viewer; give --port another"
        else:
            said = f"nothing can listen on {host}, port {port}: {error}; give another --host"
        raise PlaceError(said) from error
    return listening


def _tell_when_ready(
    server: uvicorn.Server,
    address: str,
    tell: Callable[[str], None],
    show: Callable[[str], object] | None,
) -> None:
    """Say the address once the server answers, and open it."""
    while not server.started:
        if server.should_exit:
            return
        time.sleep(0.05)
    tell(address)
    if show is not None:
        show(address)


def warm_up(holdings: Holdings) -> None:
    """List the takes and load the compiled search before they are first asked for."""
    with contextlib.suppress(ValueError, OSError):  # a page tells what is wrong with the archive
        holdings.records()
    rows = np.zeros((ROWS, 4), np.float32)
    present = np.ones(len(JOINTS), np.bool_)
    take = PackedTake("nothing", rows, INDEX_RATE_HZ, 4, present)
    search_takes(Query(rows, present), [take])


def quiet_libraries() -> None:
    """Let only faults of the libraries behind the pages be heard."""
    for name in ("nicegui", "uvicorn", "uvicorn.error", "engineio", "socketio"):
        logging.getLogger(name).setLevel(logging.ERROR)
    logging.getLogger("uvicorn.error").addFilter(_is_fault)


def _is_fault(record: logging.LogRecord) -> bool:
    """Say whether a record tells more than that an answer was under way when the viewer ended."""
    kind = record.exc_info[0] if record.exc_info else None
    cut_off = kind is not None and issubclass(kind, asyncio.CancelledError)
    return not cut_off and "graceful shutdown" not in record.getMessage()
