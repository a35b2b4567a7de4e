"""Who says an option by a name of before is told today's."""

import pytest

from bpn.cli import parse


@pytest.mark.parametrize(("given", "said"), [
    (["train", "reaching", "--nodes", "3"], "--nodes is called --hidden-units now"),
    (["train", "reaching", "--batch", "3"], "--batch is called --batch-size now"),
    (["train", "reaching", "--engine", "fast"], "called --backend now (fast is native, plain is torch)"),
    (["train", "reaching", "--mask-terminals"], "called --bootstrap-terminals now, the opposite of it"),
    (["runs", "start", "reaching", "--datasets", "3"], "--datasets is called --replay-iterations now"),
    (["reproduce", "reaching", "--nodes", "32"], "--nodes is called --hidden-units now"),
])  # fmt: skip
def test_options_of_before_are_refused_with_those_of_today(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(given)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()  # sixty options above it would hide it
    assert said in line
    assert "--help` has the options" in line
