import pytest

from bpn_shared.runtime.entry import slot_options, slot_parser


@pytest.mark.parametrize(
    "arguments",
    [["--run", "00000000-0000-0000-0000-000000000001"], ["--slot", "0"]],
)
def test_half_a_place_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_status:
        slot_options(slot_parser("edge", "an edge"), arguments)
    assert exit_status.value.code == 2
    assert "--run and --slot belong together" in capsys.readouterr().err
