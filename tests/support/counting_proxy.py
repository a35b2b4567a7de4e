"""A TCP relay that counts what crosses it: the line between two sites."""

import contextlib
import socket
import threading
from typing import Self

CHUNK_BYTES = 64 * 1024


class CountingProxy:
    """Relays connections to `localhost`, listening there: at the loopback that it names first, as Zenoh does.

    Attributes:
        port: where it listens.
        there_bytes: sent towards the target so far.
        back_bytes: sent back so far.
    """

    def __init__(self, target_port: int) -> None:
        self._target_port = target_port
        family, _, _, _, address = socket.getaddrinfo("localhost", 0, type=socket.SOCK_STREAM)[0]
        self._listener = socket.create_server(address[:2], family=family)
        self.port: int = self._listener.getsockname()[1]
        self.there_bytes = self.back_bytes = 0
        self._open: list[socket.socket] = [self._listener]

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.cut()

    def cut(self) -> None:
        """Ends all connections and takes no more."""
        for connection in self._open:
            with contextlib.suppress(OSError):  # closed at the other end
                connection.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits in it
            connection.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(("localhost", self._target_port))
            except OSError:
                return
            for connection in (near, far):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._open += [near, far]
            for source, sink, name in ((near, far, "there_bytes"), (far, near, "back_bytes")):
                threading.Thread(target=self._relay, args=(source, sink, name), daemon=True).start()

    def _relay(self, source: socket.socket, sink: socket.socket, name: str) -> None:
        try:
            while data := source.recv(CHUNK_BYTES):
                setattr(self, name, getattr(self, name) + len(data))
                sink.sendall(data)
        except OSError:
            pass
        finally:
            sink.close()
