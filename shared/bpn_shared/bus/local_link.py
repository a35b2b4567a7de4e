"""What robot and edge say to each other past the router, where both are processes of one user on one machine.

The robot listens at a Unix socket and holds a liveliness token with the socket's name. An edge that finds the
socket connects, any other goes on by the router: the link is only a shorter way for what may go by both.
"""

import logging
import threading
from collections.abc import Callable

from bpn_shared.backoff import Backoff
from bpn_shared.bus import local_socket
from bpn_shared.bus.latest import OnMessage
from bpn_shared.bus.liveliness import Token, TokenWatch
from bpn_shared.bus.local_socket import LocalConnection
from bpn_shared.bus.session import Bus
from bpn_shared.closing import Closing
from bpn_shared.errors import one_line

log = logging.getLogger(__name__)

MAX_CONNECTIONS = 4
"""At either end: the one that is used, and those of processes that were replaced and have not noticed yet."""
_RETRY_FIRST_S, _RETRY_MAX_S = 0.1, 2.0


class LocalServer(Closing):
    """The robot's end: sends to every edge that is connected.

    Args:
        key: from the socket's name to the token's key.
        sent_key, received_key: where on the bus the messages would go, and come.
        attachment_bytes, max_bytes: of a message that comes (`LocalConnection`).
        on_message: takes what comes, on a thread for each connection.
        on_lost: is called when a connection has ended.
    """

    def __init__(
        self,
        bus: Bus,
        key: Callable[[str], str],
        sent_key: str,
        received_key: str,
        *,
        attachment_bytes: int,
        max_bytes: int,
        on_message: OnMessage,
        on_lost: Callable[[], None],
    ) -> None:
        self._sizes = attachment_bytes, max_bytes
        self._on_message, self._on_lost = on_message, on_lost
        self._sent, self._received = bus.traffic.sent(sent_key), bus.traffic.received(received_key)
        self._lock = threading.Lock()
        self._connections: tuple[LocalConnection, ...] = ()
        self._closing = threading.Event()
        self._token: Token | None = None
        try:
            self._listener, self._path = local_socket.listen()
        except OSError as error:
            log.info("everything goes through the router: %s", one_line(error))
            self._closing.set()
            return
        self._thread = threading.Thread(target=self._accept, name="local link", daemon=True)
        self._thread.start()
        self._token = Token(bus, key(self._path.name))
        bus.before_close(self.close)

    @property
    def _closed(self) -> bool:
        return self._closing.is_set()

    def _accept(self) -> None:
        failing = False
        while not self._closed:
            try:
                accepted, _ = self._listener.accept()
            except OSError as error:  # closed, or out of descriptors
                if not (self._closed or failing):
                    log.warning("no edge is taken in past the router: %s", one_line(error))
                failing = True
                self._closing.wait(_RETRY_MAX_S)
                continue
            failing = False
            try:
                local_socket.check_peer(accepted)
            except OSError as error:
                log.warning("an edge is refused: %s", error)
                accepted.close()
                continue
            connection = LocalConnection(accepted, *self._sizes)
            with self._lock:
                full = len(self._connections) >= MAX_CONNECTIONS
                if not full and not self._closed:
                    self._connections += (connection,)
            if full or self._closed:
                connection.close()
                continue
            log.info("an edge of this machine is reached past the router")
            threading.Thread(
                target=self._serve, args=(connection,), name="local edge", daemon=True
            ).start()

    def _serve(self, connection: LocalConnection) -> None:
        connection.receive(self._on_message, self._received)
        with self._lock:
            self._connections = tuple(c for c in self._connections if c is not connection)
        connection.close()
        if not self._closed:
            self._on_lost()

    def put(self, attachment: bytes, payload: bytes) -> bool:
        """Sends to all who are connected; whether any of them takes it."""
        taken = False
        for connection in self._connections:
            taken |= connection.put(attachment, payload)
        if taken:
            self._sent.add(len(payload))
        return taken

    def close(self) -> None:
        """Ends all connections, and listens no more."""
        with self._lock:
            if self._closed:
                return
            self._closing.set()
            connections = self._connections
        if self._token is not None:
            self._token.close()
        self._path.unlink(missing_ok=True)
        local_socket.shut(self._listener)
        for connection in connections:
            connection.close()
        self._thread.join()


OnLocalMessage = Callable[[LocalConnection, bytes, bytes, int], None]
"""As `OnMessage`, with the connection to answer at before it."""


class LocalClient(Closing):
    """The edge's end: connects with every robot that offers its socket here, again while the offer stands.

    Args:
        pattern: of the tokens' keys; their last part is the socket's name.
        received_key, attachment_bytes, max_bytes: as of `LocalServer`.
        on_message: takes what comes, on a thread for each connection.
    """

    def __init__(
        self,
        bus: Bus,
        pattern: str,
        received_key: str,
        *,
        attachment_bytes: int,
        max_bytes: int,
        on_message: OnLocalMessage,
    ) -> None:
        self._sizes, self._on_message = (attachment_bytes, max_bytes), on_message
        self._tally = bus.traffic.received(received_key)
        self._lock = threading.Lock()
        self._offers: dict[str, threading.Event] = {}
        """By the socket's name, what is set when its offer has been taken back."""
        self._followed: set[str] = set()
        """Those that have a thread, as long as there is an offer or a connection."""
        self._connections: set[LocalConnection] = set()
        self._closed = False
        self._watch = TokenWatch(bus, pattern, self._on_token)
        bus.before_close(self.close)

    def _on_token(self, key: str, stands: bool) -> None:
        name = key.rpartition("/")[2]
        with self._lock:
            if not stands:
                gone = self._offers.pop(name, None)
                if gone is not None:
                    gone.set()
                return
            if self._closed or name in self._offers or len(self._offers) >= MAX_CONNECTIONS:
                return
            self._offers[name] = threading.Event()
            if name in self._followed:  # offered before, and its connection may still be there
                return
            self._followed.add(name)
        threading.Thread(target=self._follow, args=(name,), name="local robot", daemon=True).start()

    def _follow(self, name: str) -> None:
        pauses, said = Backoff(_RETRY_FIRST_S, _RETRY_MAX_S), ""
        while (gone := self._standing(name)) is not None:
            try:
                connection = LocalConnection(local_socket.connect(name), *self._sizes)
            except FileNotFoundError:  # the robot is on another machine
                with self._lock:
                    self._followed.discard(name)
                return
            except OSError as error:
                if one_line(error) != said:
                    said = one_line(error)
                    log.info("the robot is not reached past the router: %s", said)
            else:
                self._use(connection)
            gone.wait(pauses.next_s())

    def _standing(self, name: str) -> threading.Event | None:
        """The offer of that name; None: it has been taken back, and is followed no more."""
        with self._lock:
            offer = self._offers.get(name)
            if offer is None:
                self._followed.discard(name)
            return offer

    def _use(self, connection: LocalConnection) -> None:
        with self._lock:
            if self._closed:
                connection.close()
                return
            self._connections.add(connection)
        log.info("the robot, on this machine, is reached past the router")

        def handle(attachment: bytes, payload: bytes, t_receive_ns: int) -> None:
            self._on_message(connection, attachment, payload, t_receive_ns)

        connection.receive(handle, self._tally)
        with self._lock:
            self._connections.discard(connection)
        connection.close()

    def close(self) -> None:
        """Ends all connections; nothing comes any more."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            for gone in self._offers.values():
                gone.set()
            self._offers.clear()
            connections = tuple(self._connections)
        for connection in connections:
            connection.close()
        self._watch.close()
