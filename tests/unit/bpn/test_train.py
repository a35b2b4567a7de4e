import threading
from pathlib import Path
from uuid import UUID

import pytest
from rich.console import Console

from bpn.local_run import execute, private_endpoint
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig


def test_a_run_that_somebody_else_learns_is_left_alone(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path, UUID(int=1), RunConfig())
    with folder.owned("a learner elsewhere"):
        before = folder.set_state("running", new_attempt=True)
        with pytest.raises(ConfigError, match="is being learned already"):
            execute(
                folder, endpoint=private_endpoint(), stop=threading.Event(), out=Console(quiet=True)
            )
    assert folder.state() == before
