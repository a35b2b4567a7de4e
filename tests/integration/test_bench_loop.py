"""`bpn bench loop` at both paces, tiny: that every part is measured, never how fast."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from bpn.bench import loop
from bpn_shared.errors import InputError


@pytest.mark.parametrize(("pace", "period_ms"), [("hot", 0), ("own", 145)])
def test_loop_and_yardsticks_are_measured_at_the_same_pace(
    pace: str, period_ms: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = replace(loop.PACES[pace], rounds=1, iterations=1, episodes=1, echoes=4)
    monkeypatch.setitem(loop.PACES, pace, tiny)
    result = loop.run(pace=pace)
    assert (result["pace"], result["period_ms"], result["steps"]) == (pace, period_ms, 20)
    for name in ("camera_to_action_us", "inference_us", *loop.YARDSTICKS):
        assert 0 < result[name]["p50"] <= result[name]["p99"]
    assert set(result["ratio_to"]) == set(loop.YARDSTICKS)
    assert loop.met(result | {"targets": {}})
    loop.show(result)
    assert f"{20} steps in 1 rounds" in capsys.readouterr().out


def test_a_tick_is_a_period_after_the_last_and_lost_ones_are_not_made_up_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, slept_s = [100.0], []

    def sleep(time_s: float) -> None:
        slept_s.append(round(time_s, 6))
        now_s[0] += time_s

    monkeypatch.setattr(loop.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(loop.time, "sleep", sleep)
    wait: Callable[[], None] = loop._Ticks(0.1).wait
    wait()
    now_s[0] += 0.03  # work
    wait()
    now_s[0] += 0.25  # two periods missed
    wait()
    now_s[0] += 0.04
    wait()
    assert slept_s == [0, 0.07, 0, 0.06]


def test_an_unknown_pace_is_refused() -> None:
    with pytest.raises(InputError, match="--pace fast: there are hot, own"):
        loop.run(pace="fast")
