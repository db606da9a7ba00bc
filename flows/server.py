"""The Prefect server that runs are told to: is it there, and what if it goes away."""

import functools
import logging
import os
import tempfile
from pathlib import Path

import httpx

logger = logging.getLogger(__name__)

_ANSWER_S = 10.0
"""How long a server may take to say that it is well [s]. A busy one needs some seconds."""


class ServerError(OSError):
    """Runs cannot be told to Prefect; the message says why and what to do."""


def is_server_fault(error: BaseException) -> bool:
    """Say whether an error is that the Prefect server does not answer, or not as it should."""
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
        If its folder cannot be written to, or the server that is set does not answer.
    """
    check_home()
    from prefect.settings import PREFECT_API_URL

    if url := PREFECT_API_URL.value():
        check_url(url)


def check_home() -> None:
    """See that the folder can be written to in which Prefect keeps its database."""
    home = Path(os.environ.get("PREFECT_HOME") or "~/.prefect").expanduser()
    try:
        home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=home):
            pass
    except OSError as error:
        raise ServerError(
            f"Prefect keeps its runs in {home}, which cannot be written to "
            f"({error.strerror or error}); set PREFECT_HOME to a folder that can"
        ) from error


def check_url(url: str) -> None:
    """See that the server at an API address answers."""
    advice = "start it (`prefect server start`), or unset PREFECT_API_URL"
    try:
        answer = httpx.get(f"{url.rstrip('/')}/health", timeout=_ANSWER_S)
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        said = str(error) or type(error).__name__
        raise ServerError(
            f"the Prefect server at {url} does not answer ({said}); {advice}"
        ) from error
    if answer.status_code != httpx.codes.OK or answer.text.strip() != "true":
        raise ServerError(
            f"what answers at {url} is no Prefect server that is well (status "
            f"{answer.status_code}); PREFECT_API_URL should end in /api; {advice}"
        )
