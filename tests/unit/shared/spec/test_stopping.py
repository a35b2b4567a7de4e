import operator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.stopping import StopRule

SIGNS = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(st.sampled_from(sorted(SIGNS)), NUMBERS, NUMBERS, st.sampled_from(["", " "]))
def test_a_rule_holds_as_it_reads(sign: str, bound: float, value: float, space: str) -> None:
    rule = StopRule.parse(f"eval_return{space}{sign}{space}{bound!r}")
    assert (rule.why({"eval_return": value}) is not None) == SIGNS[sign](value, bound)


def test_a_record_without_the_metric_ends_nothing() -> None:
    rule = StopRule.parse("eval_return >= 1")
    assert rule.why({"return_px": 5.0}) is None
    assert rule.why({"eval_return": "many"}) is None
    assert rule.why({"eval_return": float("nan")}) is None
    assert rule.why({"eval_return": 1.5}) == "eval_return = 1.5 >= 1"


@pytest.mark.parametrize(
    "text", ["eval_return", "eval_return = 3", ">= 3", "a >= b", "a >= inf", "a > nan"]
)
def test_what_is_no_rule_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match=r"stop_when = .*is no rule.*eval_return >= 475"):
        RunConfig.for_task("reaching", stop_when=text)


def test_a_rule_that_could_never_hold_is_refused_with_what_there_is() -> None:
    def made(rule: str, **options: Any) -> str:
        return RunConfig.for_task("reaching", stop_when=rule, **options).stop_when

    with pytest.raises(
        ConfigError, match=r"'eval_return >= 475' .*evaluate_every = 0.*set it above 0"
    ):
        made("eval_return >= 475")
    for wrong in ("nosuch > 1", "return > 1"):
        with pytest.raises(ConfigError, match=r"no such metric; one of: .*loss, .*return_px"):
            made(wrong)
    assert made("eval_return >= 475", evaluate_every=5)
    assert made("return_px > -90")
    assert made("nosuch > 1", callbacks="mine")  # which may add it


@pytest.mark.parametrize("option", ["init_from", "callbacks"])
def test_what_has_another_form_is_told_the_form_in_words(option: str) -> None:
    with pytest.raises(ConfigError, match=rf"{option} = 'no such': must be [^^]*$"):
        RunConfig.for_task("reaching", **{option: "no such"})


def test_callbacks_have_one_order_and_each_stands_there_once() -> None:
    assert RunConfig.for_task("reaching").callback_names == ()
    config = RunConfig.for_task(
        "reaching",
        callbacks="mine,best,yours",
        evaluate_every=2,
        stop_when="loss < 1",
        tensorboard=True,
    )
    assert config.callback_names == (
        "evaluation", "best", "mine", "yours", "early_stop", "tensorboard",
    )  # fmt: skip
    for wrong in ("os:system", "a,,b", "a b", "../x"):
        with pytest.raises(ConfigError, match="callbacks"):
            RunConfig.for_task("reaching", callbacks=wrong)
