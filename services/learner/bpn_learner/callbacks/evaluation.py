"""Evaluation during training: greedy episodes every few iterations, as metrics `eval_*`."""

import time
from statistics import fmean

from bpn_learner.callbacks.callback import Callback, UpdateEnd
from bpn_shared.runs.success import share


class Evaluation(Callback):
    """Plays `evaluate_episodes` every `evaluate_every` iterations, and after the last one."""

    def on_update_end(self, end: UpdateEnd) -> None:
        config, done = self.run.config, end.iteration + 1
        if not config.evaluate_every:
            return
        if done % config.evaluate_every and done != config.iterations:
            return
        start_s = time.monotonic()
        played = self.run.evaluate(config.evaluate_episodes)
        if played is None:
            return
        self.run.add("eval_return", fmean(played.returns))
        succeeded = share(played.successes)
        if succeeded is not None:
            self.run.add("eval_success", succeeded)
        self.run.add("eval_s", time.monotonic() - start_s)
