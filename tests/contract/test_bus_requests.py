import contextlib
import errno
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from bpn_shared.bus.requests import NoReplyError, RefusedError, Responder, request
from bpn_shared.bus.session import Bus, BusError
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError

OpenBus = Callable[[], Bus]
RunningRouter = Callable[[str], contextlib.AbstractContextManager[None]]


def test_the_answer_comes_back_whole(open_bus: OpenBus) -> None:
    responder = Responder(open_bus(), "test/double", lambda body: body + body, Counters())
    payload = bytes(range(256)) * 4000  # 1 MB
    assert request(open_bus(), "test/double", payload, timeout_s=5.0) == payload + payload
    del responder


def test_nobody_there_is_no_reply_and_not_a_hang(open_bus: OpenBus) -> None:
    with pytest.raises(NoReplyError, match=r"no reply at test/nobody within 5\.0 s"):
        request(open_bus(), "test/nobody", b"", timeout_s=5.0)


def test_a_refusal_carries_its_reason_and_is_counted(open_bus: OpenBus) -> None:
    def refuse(_body: bytes) -> bytes:
        raise MessageError("frame: too short")

    counters = Counters()
    responder = Responder(open_bus(), "test/refuse", refuse, counters)
    with pytest.raises(RefusedError, match="frame: too short"):
        request(open_bus(), "test/refuse", b"", timeout_s=5.0)
    assert counters.snapshot() == {"requests_refused": 1}
    del responder


def test_a_fault_in_a_handler_is_a_refusal_and_the_next_request_is_served(
    open_bus: OpenBus,
) -> None:
    def divide(body: bytes) -> bytes:
        return bytes([12 // body[0]])

    responder = Responder(open_bus(), "test/divide", divide, Counters())
    bus = open_bus()
    with pytest.raises(RefusedError, match="internal error"):
        request(bus, "test/divide", b"\x00", timeout_s=5.0)
    assert request(bus, "test/divide", b"\x04", timeout_s=5.0) == b"\x03"
    del responder


def test_a_flood_of_faults_is_counted_and_each_kind_shown_once(
    open_bus: OpenBus, caplog: pytest.LogCaptureFixture
) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/runs/1/episodes/0.bpne")

    def store(body: bytes) -> bytes:
        if body == b"store":
            raise full
        return bytes([12 // 0])

    counters, bus = Counters(), open_bus()
    with Responder(open_bus(), "test/store", store, counters):
        for body in [b"store", b"divide"] * 60:
            with pytest.raises(RefusedError) as refusal:
                request(bus, "test/store", body, timeout_s=5.0)
            if body == b"store":
                assert str(refusal.value) == "No space left on device: /runs/1/episodes/0.bpne"
    assert counters.snapshot() == {"requests_failed": 120}
    assert "division" in counters.reasons()["requests_failed"]
    said = [record for record in caplog.records if "answering at test/store" in record.getMessage()]
    assert sum(record.exc_info is not None for record in said) == 2
    assert len(said) == 2 + 3  # and the 1st, 10th and 100th


def test_who_is_closed_answers_no_more(open_bus: OpenBus) -> None:
    bus = open_bus()
    with Responder(bus, "test/echo", bytes, Counters()) as responder:
        asking = open_bus()  # after it: who was there before hears of it a little later
        assert request(asking, "test/echo", b"1", timeout_s=5.0) == b"1"
    with pytest.raises(NoReplyError):
        request(asking, "test/echo", b"2", timeout_s=1.0)
    responder.close()  # once more does nothing
    with Responder(bus, "test/echo", bytes, Counters()) as responder:
        bus.close()
    responder.close()  # after its session neither


def test_a_handler_that_never_answers_ends_at_the_deadline(open_bus: OpenBus) -> None:
    release = threading.Event()

    def hang(_body: bytes) -> bytes:
        release.wait(30)
        return b""

    responder = Responder(open_bus(), "test/hang", hang, Counters())
    with pytest.raises(NoReplyError):
        request(open_bus(), "test/hang", b"", timeout_s=0.3)
    release.set()
    del responder


def test_a_service_that_starts_before_the_router_finds_it(
    running_router: RunningRouter, free_tcp_endpoint: str
) -> None:
    opened: list[Bus] = []
    thread = threading.Thread(target=lambda: opened.append(Bus(free_tcp_endpoint, deadline_s=20.0)))
    thread.start()
    with running_router(free_tcp_endpoint):
        thread.join(20)
        assert opened
        assert opened[0].connected
        opened[0].close()


def test_no_router_is_an_error_that_names_the_remedy(free_tcp_endpoint: str) -> None:
    with pytest.raises(BusError, match="start one with `bpn-router`"):
        Bus(free_tcp_endpoint, deadline_s=0.3)


def test_requests_work_again_after_the_router_was_replaced(
    running_router: RunningRouter, free_tcp_endpoint: str, wait_for: Callable[..., None]
) -> None:
    def answers() -> bool:
        try:
            return request(asking, "test/echo", b"2", timeout_s=0.5) == b"2"
        except NoReplyError:
            return False

    with running_router(free_tcp_endpoint):
        served, asking = Bus(free_tcp_endpoint), Bus(free_tcp_endpoint)
        responder = Responder(served, "test/echo", lambda body: body, Counters())
        wait_for(answers, "an answer through the first router")
    assert not answers()
    with running_router(free_tcp_endpoint):
        wait_for(answers, "an answer through the second router")
        served.close()
        asking.close()
    del responder


def test_no_request_is_lost_when_many_ask_at_once(open_bus: OpenBus) -> None:
    # Fewer threads for Zenoh (ZENOH_RUNTIME) are faster and lose requests here.
    responder = Responder(open_bus(), "test/echo", lambda body: body, Counters())
    sessions = [open_bus() for _ in range(3)]

    def ask(bus: Bus, size: int) -> list[bytes]:
        return [request(bus, "test/echo", bytes(size), timeout_s=10.0) for _ in range(1000)]

    with ThreadPoolExecutor() as pool:
        asked = [
            pool.submit(ask, bus, size) for bus, size in zip(sessions, (20, 200, 7080), strict=True)
        ]
        for future, size in zip(asked, (20, 200, 7080), strict=True):
            assert future.result(120) == [bytes(size)] * 1000
    del responder
