"""A way to an object store on which answers come late, or not at all for a while."""

import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_PIECE_BYTES = 1 << 16
_LOOK_S = 0.02


class SlowWay:
    """Hands connections on to a server, and what it answers back, later."""

    def __init__(self, server: tuple[str, int]) -> None:
        self.late_s = 0.0
        """How long each piece of an answer is held back [s]."""
        self.answers = math.inf
        """After how many more requests no answer comes; what is asked for still arrives."""
        self.asked = 0
        """How many requests there were."""
        self._server = server
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._open: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._begin(self._accept)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._listening.getsockname()[1]}"

    def close(self) -> None:
        for each in (self._listening, *self._open):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)  # who waits for it is woken
        for thread in self._threads:
            thread.join()
        for each in (self._listening, *self._open):
            each.close()

    def _begin(self, work: Callable[..., None], *ends: socket.socket) -> None:
        thread = threading.Thread(target=work, args=ends, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                asking, _ = self._listening.accept()
                asked = socket.create_connection(self._server)
                self._open += [asking, asked]
                self._begin(self._pass, asking, asked)
                self._begin(self._pass, asked, asking)

    def _pass(self, source: socket.socket, into: socket.socket) -> None:
        with suppress(OSError):
            is_answer = source.getpeername() == self._server
            while piece := source.recv(_PIECE_BYTES):
                if not is_answer and b" HTTP/1.1\r\n" in piece:
                    self.asked += 1
                    self.answers -= 1
                time.sleep(self.late_s if is_answer else 0)
                while is_answer and self.answers < 0:
                    time.sleep(_LOOK_S)
                into.sendall(piece)
        for end in (source, into):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


@contextmanager
def slow_way(url: str) -> Iterator[SlowWay]:
    """Give a slow way to the server at `url`, http://HOST:PORT."""
    host, _, port = url.removeprefix("http://").partition(":")
    way = SlowWay((host, int(port)))
    try:
        yield way
    finally:
        way.answers = math.inf
        way.close()
