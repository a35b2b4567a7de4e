"""Adds to the metrics by how much the return has changed: `bpn train reaching --callbacks gap`."""

from bpn_learner.callbacks import Callback, UpdateEnd


class Gap(Callback):
    """Adds the change of the return to the metrics."""

    before: float | None = None

    def on_update_end(self, end: UpdateEnd) -> None:
        now = end.record[self.run.config.task_spec.return_metric]
        assert isinstance(now, float)
        if self.before is not None:
            self.run.add("return_change", now - self.before)
        self.before = now
