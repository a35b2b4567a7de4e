"""Early stop: the run is finished as soon as a metric is good, or bad, enough."""

from bpn_learner.callbacks.callback import Callback, TrainingRun, UpdateEnd
from bpn_shared.spec.stopping import StopRule


class EarlyStop(Callback):
    """Ends the run when `stop_when` holds."""

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        rule = run.config.stop_when
        self._rule = StopRule.parse(rule) if rule else None
        if run.records:  # the learner may have died between the last record and the run's end
            self._look(dict(run.records[-1]))

    def on_update_end(self, end: UpdateEnd) -> None:
        self._look(dict(end.record))

    def _look(self, record: dict[str, object]) -> None:
        why = self._rule.why(record) if self._rule else None
        if why is not None:
            iteration = record["iteration"]
            self.run.stop(f"stopped early after iteration {iteration}: {why}")
