"""A Dask cluster by its name, and its workers for a search, which needs no Prefect."""

import re
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tasks.retrieval.archive_search import Cluster

THREADS, DASK = "threads", "dask"

_ADDRESS = re.compile(r"dask://(?P<host>\[[0-9a-fA-F:]+\]|[\w.-]+):(?P<port>\d{1,5})/?")
_ANSWER_S = 10.0
"""How long a scheduler may take to answer [s]. Dask itself would wait for half a minute."""


def scheduler_address(name: str) -> str | None:
    """Return the address of a scheduler that answers, None for one to be started here.

    Parameters
    ----------
    name
        "dask", for a cluster of this machine's processors, or "dask://HOST:PORT", for the
        scheduler of one that runs.

    Raises
    ------
    ValueError
        If it is neither, or Dask is not installed.
    ConnectionError
        If no scheduler answers there.
    """
    found = _ADDRESS.fullmatch(name)
    if name != DASK and not (found and 0 < int(found["port"]) < 1 << 16):
        raise ValueError(
            f"there is no runner {name!r}; choose {THREADS}, {DASK}, or dask://HOST:PORT of a "
            "scheduler that runs"
        )
    try:
        import_module("distributed")
    except ImportError as error:
        raise ValueError(
            f"the runner {name!r} needs Dask; install shosa with its extra: pip install "
            "'shosa[dask]'"
        ) from error
    if not found:
        return None
    host, port = found["host"].strip("[]"), int(found["port"])
    try:
        socket.create_connection((host, port), timeout=_ANSWER_S).close()
    except OSError as error:
        raise ConnectionError(
            f"no Dask scheduler answers at {name} ({error.strerror or error}); start one with "
            "`dask scheduler`, and its workers with `dask worker`"
        ) from error
    return f"tcp://{found['host']}:{port}"


@contextmanager
def search_cluster(name: str) -> "Iterator[Cluster | None]":
    """Give what searches the segments of an index; None for the threads of this process.

    Parameters
    ----------
    name
        "threads", or as of `scheduler_address`.

    Raises
    ------
    ValueError, ConnectionError
        As `scheduler_address`; also if a cluster has no workers.
    """
    if name == THREADS:
        yield None
        return
    address = scheduler_address(name)
    from distributed import Client, LocalCluster

    from tasks.retrieval.archive_search import Cluster

    with ExitStack() as stack:
        local: dict[str, Any] = {"threads_per_worker": 1, "dashboard_address": None}
        at = address or stack.enter_context(LocalCluster(**local))
        client: Any = stack.enter_context(Client(at))
        if not (at_once := sum(client.nthreads().values())):
            raise ConnectionError(
                f"the scheduler at {name} has no workers; start some with `dask worker`"
            )
        # not pure: what a worker found in an archive some time ago is no answer now
        yield Cluster(client.get_executor(pure=False), at_once)
