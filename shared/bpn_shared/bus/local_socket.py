"""Unix sockets between two processes of one user on one machine, which carry whole messages.

A message is an attachment of a size that both ends know, and a payload. It arrives whole or not at all, and
sending never blocks.
"""

import contextlib
import errno
import os
import secrets
import socket
import stat
import struct
import tempfile
import time
from pathlib import Path

from bpn_shared.bus.latest import OnMessage
from bpn_shared.bus.traffic import Tally

_CREDENTIALS = struct.Struct("iII")  # pid, uid, gid
_KIND = socket.AF_UNIX, socket.SOCK_SEQPACKET
_BACKLOG = 4
_BUFFER_BYTES = 1 << 20
"""What is asked for; the kernel gives what it may (net.core.wmem_max, 208 KiB where nobody has changed it)."""


def directory() -> Path:
    """Where this user's sockets are, which nobody else may enter.

    Raises:
        OSError: it cannot be made, or somebody else has made it or may enter it.
    """
    path = Path(tempfile.gettempdir()) / f"bpn-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    found = path.lstat()
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
    if not private or found.st_uid != os.getuid():
        raise PermissionError(
            f"{path} is not a folder that this user alone may enter: remove it, or set TMPDIR"
        )
    return path


def listen() -> tuple[socket.socket, Path]:
    """A socket that listens under a new name, after those were removed whose processes have died.

    Raises:
        OSError: there is no place for it (`directory`), or the place's path is too long for a socket.
    """
    folder = directory()
    for path in folder.glob("*.sock"):
        if _is_deserted(path):
            path.unlink(missing_ok=True)
    name = secrets.token_hex(16)
    listener, unready = socket.socket(*_KIND), folder / f"{name}.new"
    try:
        listener.bind(str(unready))
        listener.listen(_BACKLOG)
        return listener, unready.rename(folder / f"{name}.sock")
    except OSError:
        listener.close()
        raise


def connect(name: str) -> socket.socket:
    """A connection with whoever listens under that name here.

    Raises:
        FileNotFoundError: nobody on this machine, or it is another user.
        OSError: there is such a socket, and nobody listens at it (any more), too many wait there already, or it is
            another user's.
    """
    connection = socket.socket(*_KIND)
    try:
        connection.setblocking(False)  # who takes nobody in is asked again later
        connection.connect(str(directory() / Path(name).name))
        connection.setblocking(True)
        check_peer(connection)
    except OSError:
        connection.close()
        raise
    return connection


def check_peer(connection: socket.socket) -> None:
    """Refuses a process of another user at the other end.

    Raises:
        PermissionError: it is one.
    """
    told = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    uid = _CREDENTIALS.unpack(told)[1]
    if uid != os.getuid():
        raise PermissionError(f"the process at the other end is user {uid}'s, not {os.getuid()}'s")


def _is_deserted(path: Path) -> bool:
    """Asked with another kind of socket, which no listener here takes for an edge."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        return probe.connect_ex(str(path)) == errno.ECONNREFUSED


def shut(connection: socket.socket) -> None:
    """Closes a socket so that whichever thread waits at it goes on."""
    with contextlib.suppress(OSError):  # the other end has gone
        connection.shutdown(socket.SHUT_RDWR)
    connection.close()


class LocalConnection:
    """One end of a connection.

    Args:
        attachment_bytes: of every message that comes here.
        max_bytes: of such a message, attachment included; a longer one ends the connection.
    """

    def __init__(self, connection: socket.socket, attachment_bytes: int, max_bytes: int) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        self._connection = connection
        self._attachment_bytes, self._max_bytes = attachment_bytes, max_bytes

    def put(self, attachment: bytes, payload: bytes) -> bool:
        """Sends a message; False if the other end takes none now, is gone, or takes none so large."""
        try:
            self._connection.sendmsg((attachment, payload), (), socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def receive(self, handler: OnMessage, tally: Tally) -> None:
        """Calls `handler` with every message, on this thread, until either end closes the connection."""
        receive, clock_ns = self._connection.recv, time.monotonic_ns
        size, most_bytes = self._attachment_bytes, self._max_bytes
        while True:
            try:
                message = receive(most_bytes + 1)
            except OSError:
                return
            now_ns = clock_ns()
            if not size <= len(message) <= most_bytes or not message:
                return
            handler(message[:size], message[size:], now_ns)
            tally.add(len(message) - size)

    def close(self) -> None:
        """Ends it, for both ends; `receive` returns."""
        shut(self._connection)
