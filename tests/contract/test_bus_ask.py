"""Asking until there is an answer: what ends it, what is counted, and that nobody is stormed."""

import threading
from collections.abc import Callable

import pytest

from bpn_shared.backoff import Backoff
from bpn_shared.bus.requests import RefusedError, Responder
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError
from bpn_shared.runtime.ask import ask
from bpn_shared.waiting import WaitStatus

OpenBus = Callable[[], Bus]
KEY = "test/ask"


class Asking:
    """One who asks, on a thread of its own."""

    def __init__(self, bus: Bus, decode: Callable[[bytes], str] = bytes.decode) -> None:
        self.stop, self.waiting = threading.Event(), WaitStatus()
        self.refusals: list[str] = []
        self.answers: list[str | None] = []
        self._bus, self._decode = bus, decode
        self._thread = threading.Thread(target=self._ask)
        self._thread.start()

    def _ask(self) -> None:
        self.answers.append(
            ask(
                self._bus,
                KEY,
                b"what?",
                self._decode,
                stop=self.stop,
                waiting=self.waiting,
                waiting_for="an answer",
                on_refusal=self.refusals.append,
                backoff=Backoff(0.001, 0.01),
            )
        )

    def answer(self) -> str | None:
        self._thread.join(20)
        return self.answers[0]


def test_who_answers_late_is_asked_until_then(
    open_bus: OpenBus, wait_for: Callable[..., None]
) -> None:
    asking = Asking(open_bus())
    wait_for(lambda: asking.waiting.snapshot()[0] == "an answer", "it to say what it waits for")
    responder = Responder(open_bus(), KEY, lambda _: b"42", Counters())
    assert asking.answer() == "42"
    assert asking.refusals == []
    del responder


def test_a_refusal_is_told_and_asked_again(open_bus: OpenBus) -> None:
    answers = [RefusedError("not yet"), MessageError("no such thing"), b"damaged", b"good"]

    def answer(_body: bytes) -> bytes:
        this = answers.pop(0)
        if isinstance(this, Exception):
            raise this
        return this

    def decode(body: bytes) -> str:
        if body == b"damaged":
            raise MessageError("cannot be read")
        return body.decode()

    responder = Responder(open_bus(), KEY, answer, Counters())
    asking = Asking(open_bus(), decode)
    assert asking.answer() == "good"
    assert asking.refusals == ["not yet", "no such thing", "cannot be read"]
    del responder


def test_stop_ends_it_without_an_answer(open_bus: OpenBus, wait_for: Callable[..., None]) -> None:
    asking = Asking(open_bus())
    wait_for(lambda: asking.waiting.snapshot()[0], "the first try")
    asking.stop.set()
    assert asking.answer() is None


def test_who_is_told_of_refusals_can_end_it(open_bus: OpenBus) -> None:
    def refuse(_body: bytes) -> bytes:
        raise RefusedError("never")

    def give_up(reason: str) -> None:
        raise ValueError(reason)

    responder = Responder(open_bus(), KEY, refuse, Counters())
    with pytest.raises(ValueError, match="never"):
        ask(
            open_bus(), KEY, b"", bytes, stop=threading.Event(), waiting=WaitStatus(),
            waiting_for="an answer", on_refusal=give_up,
        )  # fmt: skip
    del responder
