"""Examine an installation: what works, what does not, and what to do about it."""

import importlib
import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import requires, version

from flows.server import ServerError, check_home, check_url
from storage.provenance import shosa_version

_MODULES = {
    "numpy": "numpy",
    "numba": "numba",
    "scipy": "scipy",
    "zarr": "zarr",
    "xarray": "xarray",
    "obstore": "obstore",
    "opencv-contrib-python-headless": "cv2",
    "prefect": "prefect",
}


@dataclass(frozen=True)
class Finding:
    """One thing that was examined."""

    good: bool
    text: str


def examine_installation() -> list[Finding]:
    """Try everything that shosa stands on, and say what came of it."""
    findings = [_python()]
    findings += [_library(package, module) for package, module in _MODULES.items()]
    findings += list(_checks())
    findings += list(_prefect())
    return findings


def _python() -> Finding:
    """Say which Python and machine this is."""
    text = (
        f"Python {platform.python_version()} ({sys.executable}), shosa {shosa_version()}, "
        f"{os.cpu_count()} cores"
    )
    return Finding(sys.version_info >= (3, 11), text)


def _library(package: str, module: str) -> Finding:
    """Import a library and compare its version with what shosa asks for."""
    wanted = next(
        (r for r in requires("shosa") or () if r.split(";")[0].startswith(package)), package
    )
    try:
        importlib.import_module(module)
        return Finding(True, f"{package} {version(package)} (wanted {wanted})")
    except Exception as error:  # whatever a broken library raises is the finding
        advice = "run `make setup` again, in an environment of its own"
        return Finding(False, f"{package} cannot be imported: {error}; {advice}")


def _checks() -> Iterator[Finding]:
    """Try what the libraries are needed for."""
    try:
        from tasks.checks.installation import (
            check_archive,
            check_compiler,
            check_disk,
            check_kernel_cache,
            check_memory,
        )
    except Exception as error:  # whatever a broken library raises is the finding
        yield Finding(False, f"shosa itself cannot be imported: {error}")
        return
    yield _tried("compiler", check_compiler)
    yield _tried("compiled code is kept", check_kernel_cache)
    yield _tried("memory", check_memory)
    yield _tried("disk", check_disk)
    yield _tried("archive", check_archive)


def _tried(what: str, check: Callable[[], str]) -> Finding:
    """Run a check that returns what it saw and raises what is wrong."""
    try:
        return Finding(True, check())
    except Exception as error:  # whatever is broken is the finding
        return Finding(False, f"{what}: {error}")


def _prefect() -> Iterator[Finding]:
    """Say where flows report to."""
    try:
        check_home()
        from prefect.settings import PREFECT_API_URL

        url = PREFECT_API_URL.value()
        if url:
            check_url(url)
    except ServerError as error:
        yield Finding(False, str(error))
        return
    except Exception as error:  # whatever a broken library raises is the finding
        yield Finding(False, f"Prefect's settings cannot be read: {error}")
        return
    if url:
        yield Finding(True, f"flows report to the Prefect server at {url}")
    else:
        text = "no Prefect server is set: each flow starts one of its own (about 20 s); "
        yield Finding(True, text + "`prefect server start` and PREFECT_API_URL save that")
