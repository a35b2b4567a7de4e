"""A run's metrics at Weights & Biases; where, and whether at once or later, its own environment variables say.

`WANDB_PROJECT` is "bpn" unless it is set. What it is given, a process of its own sends: no training waits.
"""

import logging
import os
from collections.abc import Mapping

from bpn_learner.callbacks.callback import Callback, RunEnd, TrainingRun, UpdateEnd
from bpn_learner.callbacks.extras import check_extra
from bpn_shared.errors import one_line
from bpn_shared.spec.config import ConfigError

check_extra("wandb")
os.environ.setdefault("WANDB_ERROR_REPORTING", "false")  # only what somebody asked for is told
import wandb  # noqa: E402

log = logging.getLogger(__name__)

_BEGIN_S, _END_S = 30.0, 30.0
"""How long it may take to begin a run there, and to send the rest at its end."""


class WeightsAndBiases(Callback):
    """Each attempt goes on with the run of the same id; what it repeats of an iteration is left out there."""

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        # without its parents, as W&B would: a removed run stays removed
        (run.folder / "wandb").mkdir(exist_ok=True)
        config = run.config
        try:
            self._run = wandb.init(
                dir=run.folder,
                project=os.environ.get("WANDB_PROJECT", "bpn"),
                id=run.folder.name,
                name=os.environ.get("WANDB_NAME") or f"{config.task} {run.folder.name[-8:]}",
                resume="allow",
                reinit="create_new",
                config=config.model_dump(mode="json"),
                settings=wandb.Settings(
                    console="off",
                    silent=True,
                    disable_code=True,
                    disable_git=True,
                    login_timeout=1.0,  # where there is a terminal it would ask for a key
                    init_timeout=_BEGIN_S,
                    finish_timeout=_END_S,
                    finish_timeout_raises=True,
                ),
            )
        except (wandb.errors.Error, OSError) as error:
            raise ConfigError(
                f"callback 'wandb': {one_line(error)}; `wandb login` tells it a key, and WANDB_MODE=offline "
                "keeps the metrics in the run's folder, for `wandb sync`"
            ) from error
        log.info("Weights & Biases: %s", self._run.url or f"offline, {self._run.dir}")

    def on_update_end(self, end: UpdateEnd) -> None:
        self._run.log(_numbers(end.record), step=end.iteration)

    def on_run_end(self, end: RunEnd) -> None:
        if end.reason:
            self._run.summary["ended_early"] = end.reason
        self._run.finish(exit_code=0 if end.finished else 1)


def _numbers(record: Mapping[str, object]) -> dict[str, int | float]:
    return {name: value for name, value in record.items() if isinstance(value, int | float)}
