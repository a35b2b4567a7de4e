"""A run, as programs read it: configuration, metrics, episodes, policies."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bpn.stored import stored_episodes, with_rewards
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import Weights
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder, is_run_id
from bpn_shared.spec.config import RunConfig

if TYPE_CHECKING:
    import pandas

    from bpn.policy import Policy

Version = int | Literal["best"] | None
"""Of weights: a number; the best in the evaluations during training; None is the newest."""


def open_run(path: Path | str, *, runs_dir: Path | str = "runs") -> "Run":
    """Opens a run for reading, whether it is being learned or over.

    Args:
        path: of its folder; or its id, or a unique beginning or end of it.
        runs_dir: where runs are, for an id.

    Raises:
        InputError: there is no such run, or several.
    """
    folder = Path(path)
    if folder.is_dir():
        folder = folder.resolve()
        if is_run_id(folder.name) and (folder / "config.json").is_file():
            return Run(RunFolder(folder))
        raise InputError(
            f"{path} is no run's folder: it is named by the run's id and has a config.json"
        )
    if len(folder.parts) != 1:
        raise InputError(f"{path}: there is no such folder")
    return Run(RunFolder.open(Path(runs_dir), str(path)))


class Run:
    """One run, which `open_run` and `train` give.

    Attributes:
        folder: the run's files.
    """

    def __init__(self, folder: RunFolder) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"<Run {self.id}: {self.config.algorithm}, {self.config.task}>"

    @property
    def id(self) -> str:
        """The run's UUID."""
        return str(self.folder.run)

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.folder.path

    @cached_property
    def config(self) -> RunConfig:
        """The run's configuration, which never changes.

        Raises:
            ConfigError: it is damaged, or of a version that this program cannot read.
        """
        return self.folder.config()

    @property
    def state(self) -> str:
        """What becomes of it now: queued, running, finished, failed, stopped or lost."""
        return self.folder.state().state

    def records(self) -> list[dict[str, Any]]:
        """What every iteration measured, in order; docs/metrics.md has the names and units."""
        return self.folder.metrics()

    def metrics(self) -> "pandas.DataFrame":
        """`records` as a pandas.DataFrame with a row for each iteration.

        Raises:
            InputError: pandas is not installed.
        """
        try:
            from pandas import DataFrame  # noqa: PLC0415 - an extra
        except ModuleNotFoundError as error:
            raise InputError(
                "Run.metrics needs pandas, which is not installed: pip install 'bpn[data]'; "
                "Run.records does without"
            ) from error
        return DataFrame.from_records(self.records())

    def episodes(self, iteration: int | None = None) -> Iterator[Episode]:
        """The stored episodes in order, read one after the other, their rewards filled in.

        Args:
            iteration: only its episodes; None: all.

        Returns:
            For each, `frames` uint8[T+1, c, height, width], `actions` uint8[T], or uint8[T, D] of D dimensions,
            `rewards` float64[T] as learned from (pixels, or the environment's unit), `outputs` [T, |A|] and
            `meta`. A damaged one is left out with a warning.
        """
        told = self.folder.rewards()
        for episode in stored_episodes(self.folder, iteration=iteration):
            yield with_rewards(episode, self.config.task_spec, told)

    def weights(self, version: Version = None) -> Weights:
        """A version of the policy's parameters.

        Raises:
            InputError: there is none of that version.
            BlobError: the file is damaged, or of another network than the run's.
        """
        if version is None:
            return self._checked(self.folder.newest_weights())
        number = self.folder.best().version if version == "best" else version
        if not isinstance(number, int):
            raise InputError(f"version = {number!r} is neither a number nor 'best'")
        if not self.folder.has(f"weights/{self.folder.weights_path(number).name}"):
            newest = self.folder.newest_weights().version
            raise InputError(
                f"version = {number}: not in {self.folder.path / 'weights'}, the newest is {newest}"
            )
        return self._checked(self.folder.weights(number))

    def _checked(self, weights: Weights) -> Weights:
        if weights.spec != self.config.network:
            raise BlobError(
                f"{self.folder.weights_path(weights.version)} is of another network, {weights.spec}, "
                f"the run's is {self.config.network}: put the file back as it was, or choose another version"
            )
        return weights

    def policy(self, version: Version = None, *, kernel: str | None = None) -> "Policy":
        """What acts as the robot did with these weights.

        Args:
            version: of the weights; "best" is the one of the evaluations during training.
            kernel: what computes it, such as "golden"; None: the run's.

        Raises:
            InputError: there is no such version or kernel.
            BlobError: the weights are damaged, or not for that kernel.
        """
        from bpn.policy import Policy  # noqa: PLC0415 - it loads a kernel

        return Policy(self.config, self.weights(version), kernel=kernel)

    def export(
        self, form: str, path: Path | str | None = None, *, version: Version = None
    ) -> list[Path]:
        """Writes the run, or its policy, in another format; `bpn.export.formats.export` says which.

        Raises:
            InputError: the format is unknown or not for this run, or the path cannot be written.
        """
        from bpn.export.formats import export  # noqa: PLC0415 - it imports this module

        return export(self, form, path, version=version)
