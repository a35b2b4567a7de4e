"""`bpn bench loop` at both paces, tiny: that every part is measured, never how fast."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from bpn.bench import loop, yardsticks
from bpn_shared.errors import InputError


@pytest.mark.parametrize(("pace", "period_ms"), [("hot", 0), ("own", 145)])
def test_loop_and_yardsticks_are_measured_at_the_same_pace(
    pace: str, period_ms: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = replace(loop.PACES[pace], rounds=1, iterations=1, episodes=1, echoes=4)
    monkeypatch.setitem(loop.PACES, pace, tiny)
    result = loop.run(pace=pace)
    assert (result["pace"], result["period_ms"], result["steps"]) == (pace, period_ms, 20)
    for name in ("camera_to_action_us", loop.ROUTED, "inference_us", *loop.YARDSTICKS):
        assert 0 < result[name]["p50"] <= result[name]["p99"]
    assert set(result["ratio_to"]) == {loop.ROUTED, *loop.YARDSTICKS}
    assert set(result["targets"]) == set(loop.TARGETS) - ({"steps_per_s"} if period_ms else set())
    loop.show(result)
    assert f"{20} steps in 1 rounds" in capsys.readouterr().out


@pytest.mark.parametrize(("changes", "met"), [
    ({}, True),
    ({"steps_per_s": 1499.0}, False),
    ({"p99_to_p50": 2.1}, False),
    ({"ratio_to": {loop.ROUTED: 0.51, "direct_echo_us": 1.0}}, False),
    ({"ratio_to": {loop.ROUTED: 0.5, "direct_echo_us": 1.41}}, False),
])  # fmt: skip
def test_every_target_has_to_be_reached(changes: dict[str, object], met: bool) -> None:
    reached = {
        "targets": loop.TARGETS, "p99_to_p50": 2.0, "steps_per_s": 1500.0,
        "ratio_to": {loop.ROUTED: 0.5, "direct_echo_us": 1.4},
    }  # fmt: skip
    assert loop.met(reached | changes) == met


def test_a_tick_is_a_period_after_the_last_and_lost_ones_are_not_made_up_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, slept_s = [100.0], []

    def sleep(time_s: float) -> None:
        slept_s.append(round(time_s, 6))
        now_s[0] += time_s

    monkeypatch.setattr(yardsticks.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(yardsticks.time, "sleep", sleep)
    wait: Callable[[], None] = yardsticks.Ticks(0.1).wait
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
