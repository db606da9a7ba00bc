"""Answers that say in a sentence what is wrong, and answers that are saved as files."""

from collections.abc import Callable
from urllib.parse import quote

from fastapi import Response
from fastapi.responses import PlainTextResponse

from storage.errors import ArchiveError, InputError, UnknownNameError

TOLD = (UnknownNameError, ArchiveError, InputError, OSError, ValueError)
"""What is told in a sentence."""


def told(make: Callable[[], Response]) -> Response:
    """Return what `make` returns, or a sentence about what is wrong."""
    try:
        return make()
    except TOLD as error:
        return PlainTextResponse(str(error), 404 if isinstance(error, UnknownNameError) else 409)


def saved_as(name: str) -> dict[str, str]:
    """Return the header by which a browser saves an answer under a name."""
    return {"content-disposition": f"attachment; filename*=UTF-8''{quote(name)}"}
