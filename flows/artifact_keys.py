"""The keys under which the dashboard keeps what is shown of a take or an archive."""

import hashlib
import re

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
