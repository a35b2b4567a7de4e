"""A run's metrics as TensorBoard event files, for those who have TensorBoard open already.

The metrics line in the run folder is the truth; nothing reads these files back.
"""

from collections.abc import Mapping
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from bpn_shared.spec.config import RunConfig


class EventWriter:
    """Writes into a folder that TensorBoard can be pointed at.

    Args:
        first: the iteration to go on with; what an earlier attempt wrote from there on does not count.
    """

    def __init__(self, folder: Path, config: RunConfig, first: int) -> None:
        folder.mkdir(
            exist_ok=True
        )  # without its parents, as TensorBoard would: a removed run stays removed
        self._writer = SummaryWriter(str(folder), purge_step=first)
        if first == 0:
            text = f"```json\n{config.model_dump_json(indent=2)}\n```"
            self._writer.add_text("config", text)

    def write(self, record: Mapping[str, object]) -> None:
        """Every number of an iteration's metrics record, under its name."""
        iteration, time_unix_s = record["iteration"], record["time_unix_s"]
        for name, value in record.items():
            if isinstance(value, int | float):
                self._writer.add_scalar(name, value, iteration, time_unix_s)
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()
