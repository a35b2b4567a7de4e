"""Request and reply with deadlines.

A reply is one status byte and a body, so that a refusal by the other side (`RefusedError`) and the absence of
an answer (`NoReplyError`) can never be confused.
"""

from collections.abc import Callable

import zenoh

from bpn_shared.bus.declared import Declared
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.errors import one_line
from bpn_shared.messages.base import MessageError

_ANSWER, _REFUSAL = b"\x00", b"\x01"


class NoReplyError(RuntimeError):
    """Nobody answered within the deadline."""


class RefusedError(RuntimeError):
    """The other side answered that it does not accept the request; the message is its reason."""


def request(bus: Bus, key: str, body: bytes, *, timeout_s: float) -> bytes:
    """Asks whoever answers at `key`.

    Raises:
        NoReplyError: nobody answered within `timeout_s`.
        RefusedError: the request was refused.
    """
    tally = bus.traffic.sent(key)
    tally.add(len(body))
    replies = bus.zenoh.get(
        key,
        payload=body,
        timeout=timeout_s,
        target=zenoh.QueryTarget.BEST_MATCHING,
        consolidation=zenoh.ConsolidationMode.NONE,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
    for reply in replies:
        if reply.ok is None:
            continue
        answer = reply.ok.payload.to_bytes()
        if answer[:1] == _REFUSAL:
            raise RefusedError(answer[1:].decode(errors="replace"))
        return answer[1:]
    tally.dropped += 1
    raise NoReplyError(f"no reply at {key} within {timeout_s} s")


class Responder(Declared):
    """Answers requests at one key, one at a time, on a thread of its own.

    Args:
        handler: from request bytes to reply bytes; `MessageError`, `RefusedError` or `OSError` (a full disk) from
            it become a refusal with its message, anything else one without details.
        counters: `requests_refused` is counted here, and `requests_failed` for what the handler should not raise.
    """

    def __init__(
        self, bus: Bus, key: str, handler: Callable[[bytes], bytes], counters: Counters
    ) -> None:
        super().__init__()
        self._key = key
        self._handler = handler
        self._counters = counters
        self._received = bus.traffic.received(key)
        self._keep(bus.zenoh.declare_queryable(key, self._answer, complete=True))

    def _answer(self, query: zenoh.Query) -> None:
        with query:  # dropped at once: the asker waits for that
            body = self._body(query)
            query.reply(self._key, self._outcome(lambda: self._handler(body)))

    def _body(self, query: zenoh.Query) -> bytes:
        body = query.payload.to_bytes() if query.payload is not None else b""
        self._received.add(len(body))
        return body

    def _outcome(self, handle: Callable[[], bytes]) -> bytes:
        try:
            return _ANSWER + handle()
        except (MessageError, RefusedError) as error:
            self._counters.refuse("requests_refused", f"{self._key}: {error}")
            return _REFUSAL + str(error).encode()
        except OSError as error:
            self._counters.fault("requests_failed", f"answering at {self._key}", error)
            return _REFUSAL + one_line(error).encode()
        except Exception as error:
            self._counters.fault("requests_failed", f"answering at {self._key}", error)
            return _REFUSAL + b"internal error, see the log of the answering service"


class PatternResponder(Responder):
    """Answers requests at all keys of a pattern.

    Args:
        handler: is told the key as well: who may ask there is for the router to say.
    """

    def __init__(
        self, bus: Bus, pattern: str, handler: Callable[[str, bytes], bytes], counters: Counters
    ) -> None:
        self._handler_of_keys = handler
        super().__init__(bus, pattern, bytes, counters)

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            body, key = self._body(query), str(query.key_expr)
            query.reply(key, self._outcome(lambda: self._handler_of_keys(key, body)))
