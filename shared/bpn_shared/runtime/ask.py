"""Ask until answered: requests to services that may be away, be restarted, or refuse for a while."""

import threading
from collections.abc import Callable
from typing import TypeVar

from bpn_shared.backoff import Backoff
from bpn_shared.bus.requests import NoReplyError, RefusedError, request
from bpn_shared.bus.session import Bus
from bpn_shared.messages.base import MessageError
from bpn_shared.waiting import WaitStatus

Reply = TypeVar("Reply")
OnRefusal = Callable[[str], object]
"""Takes the reason of a refusal: it counts it, and may raise what ends the asking."""


def ask(
    bus: Bus,
    key: str,
    body: bytes,
    decode: Callable[[bytes], Reply],
    *,
    stop: threading.Event,
    waiting: WaitStatus,
    waiting_for: str,
    on_refusal: OnRefusal,
    timeout_s: float = 2.0,
    backoff: Backoff | None = None,
    meanwhile: Callable[[], object] = lambda: None,
) -> Reply | None:
    """Asks whoever answers at `key`, again and again until there is an answer that can be read.

    Args:
        decode: reads the answer; a `MessageError` from it counts as a refusal.
        stop: ends the asking.
        waiting: is told what is waited for; who asked tells it when the wait is over, since an answer may
            well be "not yet".
        waiting_for: whom and what, as in "the learner to give an episode".
        on_refusal: is told of every refusal.
        timeout_s: how long each try waits for its answer.
        backoff: the pauses between the tries.
        meanwhile: is called after every try that nobody answered.

    Returns:
        The answer; None if `stop` was set before there was one.
    """
    backoff = backoff or Backoff()
    while not stop.is_set():
        try:
            return decode(request(bus, key, body, timeout_s=timeout_s))
        except NoReplyError:
            waiting.set(waiting_for)
            meanwhile()
        except (RefusedError, MessageError) as error:
            on_refusal(str(error))
        stop.wait(backoff.next_s())
    return None
