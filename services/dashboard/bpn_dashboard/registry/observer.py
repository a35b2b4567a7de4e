"""What is to be seen of a run now: its folder, and who works on it."""

import logging
import time
from typing import Any

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.registry.states import observed
from bpn_shared.runs.folder import RunFolder, RunOwnedError
from bpn_shared.runs.state import OVER
from bpn_shared.spec.config import ConfigError

log = logging.getLogger(__name__)


class Observer:
    """Watches one run's folder.

    Attributes:
        owner: whose attempt it was at the last look, if one was running.
        elsewhere: somebody owned the run then, and it was no worker of ours.
        advanced_unix_s: when it ended its newest iteration, or began its attempt if that was later.
    """

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._progress = Progress(folder)
        self._owned_s = time.monotonic()
        self._trouble = ""
        self.owner = ""
        self.elsewhere = False
        self.advanced_unix_s = 0.0

    def iteration(self) -> int:
        """How many iterations are done."""
        return int(self._progress.read()["iteration"])

    def columns(
        self, row: RunRow, *, owned: bool, give_up: str | None, record: bool = True
    ) -> dict[str, Any]:
        """The columns of the run's row as they are now.

        What is wanted is written to the folder once no learner owns it any more: that a run was stopped
        although its learner died before it could say so, or that it is given up.

        Args:
            owned: a learner has the run's lease.
            give_up: why the run shall fail; None: it shall not.
            record: false: nothing is written, another registry serves the run.
        """
        now_s = time.monotonic()
        try:
            recorded = self._folder.state()
            over = recorded.state in OVER
            self.owner = recorded.owner if recorded.state == "running" else ""
            self.elsewhere = not owned and not over and self._folder.is_owned()
            if owned or self.elsewhere:
                self._owned_s = now_s
            elif record and not over and give_up is not None:
                recorded = self._folder.settle("failed", error=give_up, by="the registry")
            elif record and recorded.state == "running" and row.desired_state == "stopped":
                recorded = self._folder.settle("stopped", by="the registry")
            progress = self._progress.read()
        except RunOwnedError:  # just now; the next look sees it
            return {}
        except Exception as error:  # whatever lies in one folder, the others go on
            return {"error": self._tell(row, error)}
        self._trouble = ""
        self.advanced_unix_s = max(self._progress.newest_unix_s, recorded.updated_unix_s)
        state = observed(
            recorded.state,
            "running" if row.desired_state == "running" else "stopped",
            owned=owned,
            elsewhere=self.elsewhere,
            unowned_s=now_s - self._owned_s,
        )
        seen = {"state": state, "attempt": recorded.attempt, "error": recorded.error}
        return seen | progress

    def _tell(self, row: RunRow, error: Exception) -> str:
        """What is wrong with the folder; logged once."""
        expected = isinstance(error, ConfigError | OSError)
        trouble = str(error) if expected else f"{type(error).__name__}: {error}"
        if trouble != self._trouble:
            log.warning("run %s cannot be observed: %s", row.id, trouble, exc_info=not expected)
            self._trouble = trouble
        return trouble
