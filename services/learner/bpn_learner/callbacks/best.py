"""Keeping the best policy: the run folder says which version it was."""

from statistics import fmean

from bpn_learner.callbacks.callback import Callback, EvaluationEnd, TrainingRun

METRIC = "eval_return"


class BestPolicy(Callback):
    """Notes the version with the best evaluation; of equal ones the first.

    Evaluations have the same seeds, so that they can be compared with each other, and other ones than `bpn eval`,
    whose figures of the chosen version are therefore fair.
    """

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        self._best = float("-inf")
        for record in run.records:  # so that what an unfinished iteration noted is gone
            iteration, value = record["iteration"], record.get(METRIC)
            if isinstance(iteration, int) and isinstance(value, float):
                self._note(iteration + 1, value)

    def on_evaluation_end(self, end: EvaluationEnd) -> None:
        self._note(end.version, fmean(end.returns))

    def _note(self, version: int, value: float) -> None:
        if value > self._best:
            self.run.keep_best(version, METRIC, value)
            self._best = value
