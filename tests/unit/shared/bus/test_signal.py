"""The signal that resets itself, from many threads at once."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bus.signal import Signal


@given(st.lists(st.sampled_from(["tell", "wait"]), max_size=30))
def test_it_wakes_once_for_whatever_was_told_since(steps: list[str]) -> None:
    signal, told = Signal(), False
    for step in steps:
        if step == "tell":
            signal.tell()
            told = True
        else:
            assert signal.wait(0) == told
            told = False


def test_many_tell_at_once_and_none_of_them_fails() -> None:
    signal, failed = Signal(), []
    begin, tellers = threading.Barrier(9), 8

    def tell() -> None:
        begin.wait()
        try:
            for _ in range(20_000):
                signal.tell()
        except RuntimeError as error:  # a lock that was released twice
            failed.append(error)

    threads = [threading.Thread(target=tell) for _ in range(tellers)]
    for thread in threads:
        thread.start()
    begin.wait()
    woken = 0
    while any(thread.is_alive() for thread in threads):
        woken += signal.wait(0.01)
    for thread in threads:
        thread.join()
    assert not failed
    assert woken


def test_it_wakes_the_thread_that_waits() -> None:
    signal, woken = Signal(), threading.Event()

    def wait() -> None:
        if signal.wait():
            woken.set()

    threading.Thread(target=wait, daemon=True).start()
    signal.tell()
    assert woken.wait(20)
