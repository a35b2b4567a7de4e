"""The WebSocket route of the live view."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from bpn_dashboard.hub import protocol
from bpn_dashboard.hub.client import Client
from bpn_dashboard.hub.hub import FullError, Hub
from bpn_dashboard.hub.protocol import Ack, Hello, Ping, ProtocolError, Subscribe, Unsubscribe

PATH = "/api/v1/live"

UVICORN_OPTIONS: dict[str, Any] = {
    "ws": "websockets-sansio",
    "ws_per_message_deflate": False,  # pixels do not shrink, and trying took ten times the CPU
    "ws_max_size": 64 * 1024,
    "ws_ping_interval": 20.0,
    "ws_ping_timeout": 20.0,
}
"""What uvicorn has to be told for this route."""

CLOSE_PROTOCOL, CLOSE_NO_SESSION, CLOSE_FULL, CLOSE_NO_BUS = 4400, 4401, 4429, 4503
_HELLO_DEADLINE_S = 10.0
_SEND_DEADLINE_S = 60.0
_CLOSE_DEADLINE_S = 1.0
SESSION_PERIOD_S = 5.0
_MAX_ERRORS = 100

MayWatch = Callable[[WebSocket], str | None]
"""Whose share of the places who asks takes: the session's or token's; None: who has neither may not see the live
view. Asked on a thread, again and again. Foreign hosts and origins are refused before, by the guard around the
application."""


class _CloseError(Exception):
    """Ends the connection with this code."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code, self.reason = code, reason


def live_route(
    hub: Callable[[], Hub | None],
    may_watch: MayWatch,
    *,
    session_period_s: float = SESSION_PERIOD_S,
) -> APIRouter:
    """The route, for a hub that exists once the message bus is reached.

    Args:
        session_period_s: how often `may_watch` is asked again.
    """
    router = APIRouter()

    @router.websocket(PATH)
    async def live(websocket: WebSocket) -> None:
        owner = await asyncio.to_thread(may_watch, websocket)
        # A browser never tells a page why a handshake was refused, so ours is accepted, and closed with a
        # code that says so.
        await websocket.accept()
        try:
            _require(owner)
            running = hub()
            if running is None:
                raise _CloseError(CLOSE_NO_BUS, "the message bus is not reached yet; try again")
            await _serve(websocket, running, owner or "", may_watch, session_period_s)
        except WebSocketDisconnect:
            pass
        except _CloseError as error:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
                async with asyncio.timeout(_CLOSE_DEADLINE_S):  # it may take nothing, not even this
                    await websocket.close(error.code, error.reason)

    return router


def _require(owner: str | None) -> None:
    if owner is None:
        raise _CloseError(CLOSE_NO_SESSION, "no session: open the link that the dashboard printed")


class _Transport:
    """Sends, and gives up on a client that takes nothing for a minute."""

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket

    async def send_text(self, data: str) -> None:
        async with asyncio.timeout(_SEND_DEADLINE_S):
            await self._websocket.send_text(data)

    async def send_bytes(self, data: bytes) -> None:
        async with asyncio.timeout(_SEND_DEADLINE_S):
            await self._websocket.send_bytes(data)


async def _serve(
    websocket: WebSocket, hub: Hub, owner: str, may_watch: MayWatch, session_period_s: float
) -> None:
    transport = _Transport(websocket)
    try:
        await _shake_hands(websocket)  # before that it takes nobody's place
        client = hub.connect(transport, owner)
        try:
            await transport.send_text(protocol.welcome(hub.name, time.time()))
            await _until_one_ends(
                client.send_forever(),
                _receive_forever(websocket, transport, client),
                _watch_session(websocket, may_watch, session_period_s),
            )
        finally:
            hub.disconnect(client)
    except FullError as error:
        raise _CloseError(CLOSE_FULL, str(error)) from error
    except TimeoutError:
        raise _CloseError(CLOSE_PROTOCOL, "nothing was heard or taken in time") from None


async def _until_one_ends(*parts: Coroutine[Any, Any, None]) -> None:
    """Runs all until the first raises, ends the others, and raises the same."""
    tasks = [asyncio.create_task(part) for part in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _shake_hands(websocket: WebSocket) -> None:
    async with asyncio.timeout(_HELLO_DEADLINE_S):
        try:
            hello = protocol.parse_client_message(await _receive_text(websocket))
        except ProtocolError as error:
            raise _CloseError(CLOSE_PROTOCOL, str(error)[:100]) from error
    if not isinstance(hello, Hello) or hello.proto != protocol.VERSION:
        raise _CloseError(CLOSE_PROTOCOL, f"hello with proto {protocol.VERSION} comes first")


async def _receive_text(websocket: WebSocket) -> str:
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    text = message.get("text")
    if text is None:
        raise ProtocolError("a binary message; clients send text")
    return str(text)


async def _receive_forever(websocket: WebSocket, transport: _Transport, client: Client) -> None:
    """Does what the client asks for. Its answers wait for the network, and so does the next request."""
    errors = 0
    while True:
        try:
            answer = _obey(protocol.parse_client_message(await _receive_text(websocket)), client)
            if answer is not None:
                await transport.send_text(answer)
        except ProtocolError as error:
            errors += 1
            if errors > _MAX_ERRORS:
                raise _CloseError(CLOSE_PROTOCOL, "too many errors") from error
            await transport.send_text(protocol.error(error.subscription, str(error)))


def _obey(message: protocol.ClientMessage, client: Client) -> str | None:
    match message:
        case Subscribe():
            client.subscribe(message)
        case Unsubscribe():
            client.unsubscribe(message.id)
        case Ack():
            client.acknowledge(message.id, message.seq)
        case Ping():
            return protocol.pong(message.t, time.time())
        case Hello():
            raise ProtocolError("hello comes once")
    return None


async def _watch_session(
    websocket: WebSocket, may_watch: MayWatch, session_period_s: float
) -> None:
    while True:
        await asyncio.sleep(session_period_s)
        _require(await asyncio.to_thread(may_watch, websocket))
