"""The Prefect server that runs are told to: is it there, and what if it goes away."""

import functools
import logging
import os
import tempfile
import urllib.error
import urllib.request
from base64 import b64encode
from http import HTTPStatus
from http.client import HTTPException
from importlib.metadata import version
from pathlib import Path

logger = logging.getLogger(__name__)

_ANSWER_S = 10.0
"""How long a server may take to say that it is well [s]. A busy one needs some seconds."""
_MOST_BYTES = 100
"""How much of an answer is read: "true", or a version."""


class ServerError(OSError):
    """Runs cannot be told to Prefect; the message says why and what to do."""


def is_server_fault(error: BaseException) -> bool:
    """Say whether an error is that the Prefect server does not answer, or not as it should."""
    import httpx
    from prefect.exceptions import PrefectHTTPStatusError

    if isinstance(error, PrefectHTTPStatusError):
        return error.response.status_code >= httpx.codes.INTERNAL_SERVER_ERROR
    return isinstance(error, httpx.TransportError)


@functools.cache
def tell_server_is_gone() -> None:
    """Say, once a process, that runs go on without the server."""
    logger.warning(
        "the Prefect server does not answer any more: the dashboard does not show how this run "
        "ended; what is taken in is in the archive"
    )


def check_server() -> None:
    """See that runs can be told to Prefect, before one starts: it would say so after minutes.

    Raises
    ------
    ServerError
        If its folder cannot be written to, or the server that is set does not answer, or is of
        another version.
    """
    check_home()
    from prefect.settings import PREFECT_API_URL

    if url := PREFECT_API_URL.value():
        check_url(url)


def check_home(home: Path | None = None) -> None:
    """See that a folder, by default Prefect's own, can be written to, for the database of runs."""
    home = home or Path(os.environ.get("PREFECT_HOME") or "~/.prefect").expanduser()
    try:
        home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=home):
            pass
    except OSError as error:
        raise ServerError(
            f"Prefect keeps its runs in {home}, which cannot be written to "
            f"({error.strerror or error}); set PREFECT_HOME to a folder that can"
        ) from error


def is_healthy(url: str) -> bool:
    """Say whether a Prefect server answers at the URL of an API."""
    try:
        return _ask(url, "health") == (HTTPStatus.OK, "true")
    except (OSError, ValueError, HTTPException):
        return False


def check_url(url: str) -> None:
    """See that the server at an API address answers, and is of the version that is installed."""
    advice = "start it (`prefect server start`), or unset PREFECT_API_URL"
    try:
        status, said = _ask(url, "health")
    except (OSError, ValueError, HTTPException) as error:
        reason = getattr(error, "reason", error) or type(error).__name__
        raise ServerError(
            f"the Prefect server at {url} does not answer ({reason}); {advice}"
        ) from error
    if (status, said) != (HTTPStatus.OK, "true"):
        raise ServerError(
            f"what answers at {url} is no Prefect server that is well (status {status}); "
            f"PREFECT_API_URL should end in /api; {advice}"
        )
    check_version(url)


def check_version(url: str) -> None:
    """See that a server is of the version of Prefect that is installed here, but for its patches.

    Raises
    ------
    ServerError
        If it is another, or the server does not say.
    """
    ours = version("prefect")
    try:
        status, said = _ask(url, "admin/version")
    except (OSError, ValueError, HTTPException) as error:
        raise ServerError(f"the Prefect server at {url} does not say its version") from error
    if status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN):
        raise ServerError(
            f"the Prefect server at {url} wants a password; set PREFECT_API_AUTH_STRING to "
            "name:password as it was started with"
        )
    theirs = said.strip('"')
    if status != HTTPStatus.OK or theirs.split(".")[:2] != ours.split(".")[:2]:
        shown = f"of version {theirs[:20]}" if status == HTTPStatus.OK else "of an unknown version"
        raise ServerError(
            f"the Prefect server at {url} is {shown}, and {ours} is installed here; install the "
            "same shosa on both machines and start the server again, or unset PREFECT_API_URL"
        )


def _ask(url: str, path: str) -> tuple[int, str]:
    """Return the status and the text of what a server answers."""
    request = urllib.request.Request(f"{url.rstrip('/')}/{path}")
    if secret := os.environ.get("PREFECT_API_AUTH_STRING"):
        request.add_header("Authorization", f"Basic {b64encode(secret.encode()).decode()}")
    try:
        with urllib.request.urlopen(request, timeout=_ANSWER_S) as answer:
            return answer.status, answer.read(_MOST_BYTES).decode(errors="replace").strip()
    except urllib.error.HTTPError as error:
        return error.code, ""
