"""What a callback needs and is not there is said with the extra that brings it, wherever it is asked for."""

from pathlib import Path

import pytest

from bpn.cli import main
from bpn_learner.callbacks import extras
from bpn_shared import plugins
from bpn_shared.spec.config import ConfigError


@pytest.fixture(params=["tensorboard", "wandb", "mlflow"])
def missing(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    callback = str(request.param)
    monkeypatch.setitem(extras._LIBRARIES, callback, "no_library_of_that_name")
    return callback


def test_it_is_said_in_one_line_and_the_callback_is_not_usable(missing: str) -> None:
    assert missing in plugins.names(plugins.CALLBACKS)
    assert missing not in extras.usable_callbacks()
    with pytest.raises(
        ConfigError, match=rf"^callback '{missing}' needs .*'bpn-learner\[{missing}\]'$"
    ):
        extras.check_extra(missing)


def test_a_run_is_refused_before_it_is_made(
    missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["train", "reaching", "--callbacks", missing, "--runs-dir", str(tmp_path / "runs")]
    assert main(asked) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"callback '{missing}' needs" in line
    assert not list(tmp_path.rglob("config.json"))


def test_a_folder_with_a_librarys_name_is_no_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where W&B has written, there is a folder `wandb`."""
    (tmp_path / "folder_with_such_a_name").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(extras._LIBRARIES, "wandb", "folder_with_such_a_name")
    with pytest.raises(ConfigError, match="which is not installed"):
        extras.check_extra("wandb")


def test_ours_that_need_nothing_are_usable() -> None:
    assert {"evaluation", "best", "early_stop"} <= set(extras.usable_callbacks())
