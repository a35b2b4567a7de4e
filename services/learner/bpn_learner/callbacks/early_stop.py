"""Early stop: the run is finished as soon as a metric is good, or bad, enough."""

import logging
from collections.abc import Mapping

from bpn_learner.callbacks.callback import Callback, TrainingRun, UpdateEnd
from bpn_shared.spec.stopping import StopRule

log = logging.getLogger(__name__)


class EarlyStop(Callback):
    """Ends the run when `stop_when` holds."""

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        rule = run.config.stop_when
        self._rule = StopRule.parse(rule) if rule else None
        if run.records:  # the learner may have died between the last record and the run's end
            self._look(dict(run.records[-1]))

    def on_update_end(self, end: UpdateEnd) -> None:
        if end.iteration == self.run.first:
            self._doubt(end.record)
        self._look(dict(end.record))

    def _doubt(self, record: Mapping[str, object]) -> None:
        """A name that was mistyped ends nothing; evaluations may be yet to come."""
        if self._rule and self._rule.metric not in record and not self.run.config.evaluate_every:
            log.warning(
                "stop_when = %r: the metrics have no %s; they have %s",
                self.run.config.stop_when, self._rule.metric, ", ".join(record),
            )  # fmt: skip

    def _look(self, record: dict[str, object]) -> None:
        why = self._rule.why(record) if self._rule else None
        if why is not None:
            iteration = record["iteration"]
            self.run.stop(f"stopped early after iteration {iteration}: {why}")
