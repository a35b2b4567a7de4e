import pytest

from bpn_shared.runtime.entry import run_slot_worker
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig


def serve(_worker: Worker, _config: RunConfig) -> int:
    raise AssertionError("it must not come so far")


@pytest.mark.parametrize(
    "arguments",
    [["--run", "00000000-0000-0000-0000-000000000001"], ["--slot", "0"]],
)
def test_half_a_place_is_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_status:
        run_slot_worker("edge", "an edge", serve, arguments)
    assert exit_status.value.code == 2
    assert "--run and --slot belong together" in capsys.readouterr().err
