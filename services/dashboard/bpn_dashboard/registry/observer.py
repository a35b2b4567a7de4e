"""What is to be seen of a run now: its folder, and who works on it."""

import logging
import time
from typing import Any

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.registry.states import OVER, observed
from bpn_shared.config import ConfigError
from bpn_shared.runs.folder import RunFolder, RunOwnedError

log = logging.getLogger(__name__)


class Observer:
    """Watches one run's folder."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._progress = Progress(folder)
        self._owned_s = time.monotonic()

    def columns(self, row: RunRow, *, owned: bool, give_up: str | None) -> dict[str, Any]:
        """The columns of the run's row as they are now.

        What is wanted is written to the folder once no learner owns it any more: that a run was stopped
        although its learner died before it could say so, or that it is given up.

        Args:
            owned: a learner has the run's lease.
            give_up: why the run shall fail; None: it shall not.
        """
        now_s = time.monotonic()
        try:
            recorded = self._folder.state()
            elsewhere = not owned and recorded.state not in OVER and self._folder.is_owned()
            if owned or elsewhere:
                self._owned_s = now_s
            elif recorded.state not in OVER and give_up is not None:
                recorded = self._record("failed", give_up)
            elif recorded.state == "running" and row.desired_state == "stopped":
                recorded = self._record("stopped")
        except (ConfigError, RunOwnedError) as error:
            log.warning("run %s cannot be observed: %s", row.id, error)
            return {"error": str(error)}
        state = observed(
            recorded.state,
            "running" if row.desired_state == "running" else "stopped",
            owned=owned,
            elsewhere=elsewhere,
            unowned_s=now_s - self._owned_s,
        )
        seen = {"state": state, "attempt": recorded.attempt, "error": recorded.error}
        return seen | self._progress.read()

    def _record(self, state: Any, error: str = "") -> Any:
        with self._folder.owned("the registry", patience_s=0.0):
            return self._folder.set_state(state, error=error)
