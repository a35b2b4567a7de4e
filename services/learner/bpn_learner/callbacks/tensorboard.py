"""A run's metrics as TensorBoard event files, for those who have TensorBoard open already.

The metrics line in the run folder is the truth; nothing reads these files back.
"""

from collections.abc import Mapping

from bpn_learner.callbacks.callback import Callback, RunEnd, TrainingRun, UpdateEnd
from bpn_learner.callbacks.extras import check_extra

check_extra("tensorboard")
from torch.utils.tensorboard import SummaryWriter  # noqa: E402


class TensorBoard(Callback):
    """Writes into the folder `tensorboard` of the run, over what an earlier attempt wrote of an iteration."""

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        folder, first = run.folder / "tensorboard", run.first
        # without its parents, as TensorBoard would: a removed run stays removed
        folder.mkdir(exist_ok=True)
        self._writer = SummaryWriter(str(folder), purge_step=first)
        if first == 0:
            text = f"```json\n{run.config.model_dump_json(indent=2)}\n```"
            self._writer.add_text("config", text)

    def on_update_end(self, end: UpdateEnd) -> None:
        self._write(end.record)

    def _write(self, record: Mapping[str, object]) -> None:
        iteration, time_unix_s = record["iteration"], record["time_unix_s"]
        for name, value in record.items():
            if isinstance(value, int | float):
                self._writer.add_scalar(name, value, iteration, time_unix_s)
        self._writer.flush()

    def on_run_end(self, _end: RunEnd) -> None:
        self._writer.close()
