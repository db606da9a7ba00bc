"""The folders that a served archive reads from, and whether a path leads out of them."""

import errno
import os
import posixpath
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from storage.errors import InputError


def is_url(location: str) -> bool:
    """Say whether this is a place in an object store."""
    return re.match(r"^[a-z][a-z0-9+]+://", location, re.IGNORECASE) is not None


def check_within(path: str, roots: Sequence[str]) -> str:
    """Return the full path of what is at `path`, which has to lie in one of the roots.

    Links are followed, and nothing is opened; what is behind a link, too, has to lie in a root.

    Parameters
    ----------
    path
        As a person typed it: a full path, a URL, or a path in one of the roots.
    roots
        Folders and URLs.

    Raises
    ------
    InputError
        If it lies in none, is not there, or holds a link that leads out.
    """
    if "\0" in path or not path.strip():
        raise InputError(f"{path!r} is no path; give one below {_listed(roots)}")
    if is_url(path):
        return _url_within(path, roots)
    folders = [Path(root).expanduser().resolve() for root in roots if not is_url(root)]
    given = Path(path)
    tried = [given] if given.is_absolute() else [folder / given for folder in folders]
    inside = [each for each in tried if _is_inside(each, folders)]
    if not inside:
        raise InputError(
            f"{path!r} does not lie in {_listed(roots)}, and nothing else is read; move it there, "
            "or start `shosa serve` with --root"
        )
    found = next((each for each in inside if each.exists()), None)
    if found is None:
        raise InputError(f"{path!r} is not there; check the path")
    if out := next(links_out(found, roots), None):
        raise InputError(
            f"{out} is a link that leads out of {_listed(roots)}, and nothing else is read; copy "
            "the file in place of the link, or start `shosa serve` with --root"
        )
    return os.path.normpath(found.absolute())


def links_out(path: Path, roots: Sequence[str]) -> Iterator[Path]:
    """Yield what is at or below `path`, links followed, and lies in none of the roots."""
    folders = [Path(root).expanduser().resolve() for root in roots if not is_url(root)]
    if not _is_inside(path, folders):
        yield path
        return
    seen: set[tuple[int, int]] = set()
    for above, below, names in os.walk(path, followlinks=True):
        status = os.stat(above)
        if (status.st_dev, status.st_ino) in seen:
            below.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        for name in sorted([*below, *names]):
            each = Path(above, name)
            if each.is_symlink() and not _is_inside(each, folders):
                yield each
        below[:] = [name for name in below if _is_inside(Path(above, name), folders)]


def leads_to_itself(path: Path) -> bool:
    """Say whether a link ends in a loop of links, and so nowhere."""
    try:
        path.stat()
    except OSError as error:
        return error.errno == errno.ELOOP
    return False


def _is_inside(path: Path, folders: Sequence[Path]) -> bool:
    """Say whether a path, its links followed, lies in one of the folders."""
    try:
        real = path.resolve()
    except (OSError, RuntimeError):  # a loop of links
        return False
    return any(real.is_relative_to(folder) for folder in folders)


def _url_within(url: str, roots: Sequence[str]) -> str:
    """Return a URL that lies below one of the roots, or refuse it."""
    scheme, _, rest = url.partition("://")
    clean = f"{scheme.lower()}://{posixpath.normpath(rest)}"
    for root in filter(is_url, roots):
        if clean == root.rstrip("/") or clean.startswith(f"{root.rstrip('/')}/"):
            return clean
    raise InputError(
        f"{url!r} does not lie in {_listed(roots)}, and nothing else is read; copy it there, or "
        "start `shosa serve` with --root"
    )


def _listed(roots: Sequence[str]) -> str:
    return " or ".join(roots) or "any root, as `shosa serve` was given none"
