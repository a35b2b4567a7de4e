"""A run's metrics in MLflow: at `MLFLOW_TRACKING_URI`, or where MLflow writes without it.

`MLFLOW_EXPERIMENT_NAME` is "bpn" unless it is set. A server that is away delays each iteration by a try, and gets
what it has missed when it is back.
"""

import logging
import os
from collections import deque
from itertools import islice

from bpn_learner.callbacks.callback import Callback, RunEnd, TrainingRun, UpdateEnd
from bpn_learner.callbacks.extras import check_extra
from bpn_shared.errors import one_line
from bpn_shared.spec.config import ConfigError

check_extra("mlflow")
for _name, _value in (
    ("MLFLOW_DISABLE_TELEMETRY", "true"),  # only what somebody asked for is told
    ("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1"),  # training waits: the next iteration tries again
    ("MLFLOW_HTTP_REQUEST_TIMEOUT", "10"),  # s
):
    os.environ.setdefault(_name, _value)
from mlflow import MlflowClient  # noqa: E402
from mlflow.entities import Metric, Param  # noqa: E402
from mlflow.exceptions import MlflowException  # noqa: E402

log = logging.getLogger(__name__)

_RUN_ID = "bpn.run_id"
_MOST_METRICS, _MOST_PARAMETERS = 1000, 100
"""That MLflow takes at once."""
_MOST_UNSENT = 100_000
"""The oldest are left out of what is sent when a server comes back after a long time."""
_LONGEST = 500
"""Of a parameter's value, which some of its databases cannot take longer."""


class MLflow(Callback):
    """Each attempt goes on with the run that has the same tag `bpn.run_id`."""

    def __init__(self, run: TrainingRun) -> None:
        super().__init__(run)
        self._unsent: deque[Metric] = deque(maxlen=_MOST_UNSENT)
        try:
            self._client = MlflowClient()
            self._run_id = self._begin()
        except (MlflowException, OSError) as error:
            raise ConfigError(
                f"callback 'mlflow': {one_line(error)}; MLFLOW_TRACKING_URI says where it writes, such as "
                "http://127.0.0.1:5000 or sqlite:////home/me/mlflow.db"
            ) from error
        log.info("MLflow: run %s at %s", self._run_id, self._client.tracking_uri)

    def on_update_end(self, end: UpdateEnd) -> None:
        time_unix_s = end.record["time_unix_s"]
        assert isinstance(time_unix_s, float)
        self._unsent += [
            Metric(name, float(value), int(1000 * time_unix_s), end.iteration)
            for name, value in end.record.items()
            if isinstance(value, int | float)
        ]
        self._send()

    def on_run_end(self, end: RunEnd) -> None:
        self._send()
        if end.reason:
            self._client.set_tag(self._run_id, "bpn.ended_early", end.reason)
        self._client.set_terminated(self._run_id, "FINISHED" if end.finished else "KILLED")

    def _begin(self) -> str:
        experiment = self._experiment(os.environ.get("MLFLOW_EXPERIMENT_NAME", "bpn"))
        run, client = self.run.folder.name, self._client
        for before in client.search_runs([experiment], f"tags.`{_RUN_ID}` = '{run}'"):
            known: str = before.info.run_id
            client.update_run(known, status="RUNNING")
            return known
        made: str = client.create_run(
            experiment, tags={_RUN_ID: run}, run_name=f"{self.run.config.task} {run[-8:]}"
        ).info.run_id
        values = [Param(*one) for one in _flat("", self.run.config.model_dump(mode="json")).items()]
        for begin in range(0, len(values), _MOST_PARAMETERS):
            client.log_batch(made, params=values[begin : begin + _MOST_PARAMETERS])
        return made

    def _experiment(self, name: str) -> str:
        found = self._client.get_experiment_by_name(name)
        if found is None:
            try:
                return str(self._client.create_experiment(name))
            except MlflowException:  # another learner was faster
                found = self._client.get_experiment_by_name(name)
                if found is None:
                    raise
        return str(found.experiment_id)

    def _send(self) -> None:
        while self._unsent:
            some = list(islice(self._unsent, _MOST_METRICS))
            self._client.log_batch(self._run_id, metrics=some)
            for _ in some:
                self._unsent.popleft()


def _flat(before: str, value: object) -> dict[str, str]:
    if isinstance(value, dict):
        inner = (_flat(f"{before}.{name}" if before else name, v) for name, v in value.items())
        return {name: text for part in inner for name, text in part.items()}
    return {before: str(value)[:_LONGEST]}
