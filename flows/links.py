"""How dashboard and viewer find each other: keys of the pages there, and addresses of both."""

import hashlib
import os
import re

VIEWER_URL = "SHOSA_VIEWER_URL"
"""The environment variable that says where the viewer answers; tables link to it."""
_KEY_LENGTH = 60
"""Of the readable part of a key [characters]. Chosen: a line of the list of pages."""


def artifact_key(kind: str, name: str) -> str:
    """Return the key of what is shown of a take or an archive: always the same, and its own.

    Prefect allows small Latin letters, digits and hyphens. A name that has others, or is long, is
    told from those that look alike by its digest.
    """
    plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:_KEY_LENGTH].strip("-")
    if plain != name or not plain:
        digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:8]
        plain = f"{plain}-{digest}".strip("-")
    return f"{kind}-{plain}"


def viewer_url() -> str | None:
    """Return where the viewer answers, if that is known and an address of the web."""
    given = os.environ.get(VIEWER_URL, "").strip()
    return given if is_web_address(given) else None


def is_web_address(text: str) -> bool:
    """Say whether a text is an address of the web."""
    return re.match(r"https?://[^\s/]+", text) is not None
