"""Refuse what another site's page asks for: only pages of this viewer may use it.

A page anywhere on the web can send requests to loopback, or have its own name point there. A
request's Host must therefore be this machine, and what comes from another page is refused, for
HTTP and web sockets alike, before anything else sees it.
"""

import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Asgi = Callable[[Scope, Callable[..., Awaitable[Any]], Callable[..., Awaitable[None]]], Any]

_HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (
        b"content-security-policy",
        b"default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; "
        b"connect-src 'self' ws: wss:; form-action 'self'; base-uri 'self'",
    ),
)
"""What every answer says to a browser: no other page may frame, read or extend it."""


def is_own_host(host: str, bound: str) -> bool:
    """Say whether the header Host names this machine, as it was told to listen on `bound`."""
    name = (urlsplit(f"//{host}").hostname or "").rstrip(".")
    if name == "localhost" or name == bound.lower():
        return True
    try:
        address = ipaddress.ip_address(name)
    except ValueError:  # a name: an attacker's may point anywhere
        return not _is_loopback(bound) and name in (_own_name(), _own_name().split(".")[0])
    return address.is_loopback or not _is_loopback(bound)


def guard(app: Asgi, bound: str) -> Asgi:
    """Return `app` behind the rules of this module.

    Parameters
    ----------
    bound
        The host that the viewer listens on: a loopback address takes loopback names only.
    """

    async def guarded(scope: Scope, receive: Any, send: Any) -> None:
        if scope["type"] not in ("http", "websocket"):
            await app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value for name, value in scope["headers"]}
        refused = _fault({n: v.decode("latin-1") for n, v in headers.items()}, bound)
        if refused is None:
            await app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _refuse(send, refused)

    return guarded


def _fault(headers: dict[str, str], bound: str) -> str | None:
    """Return why a request with these headers is refused, or None."""
    host = headers.get("host", "")
    try:
        if not is_own_host(host, bound):
            return "this viewer answers to its own address only; open it as shosa view printed it"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return "this viewer answers to its own pages only"
    except ValueError:
        return "the request names no host"
    # what browsers say of a request that another site's page makes, other than following a link
    if headers.get("sec-fetch-site") in ("cross-site", "same-site") and not (
        headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    ):
        return "this viewer answers to its own pages only"
    return None


def _is_loopback(bound: str) -> bool:
    if bound.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(bound).is_loopback
    except ValueError:
        return False


def _own_name() -> str:
    return socket.gethostname().lower()


def _with_headers(send: Any) -> Any:
    """Return `send`, which adds what browsers are told."""

    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sending


async def _refuse(send: Any, why: str) -> None:
    head = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": 403, "headers": head})
    await send({"type": "http.response.body", "body": f"{why}\n".encode()})
