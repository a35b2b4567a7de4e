"""A run's numbers as tables: metrics by iteration, episodes by step."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from bpn.run import Run


def metrics_table(run: Run) -> Any:
    """One row for each iteration; docs/metrics.md has the columns, null where an iteration did not measure one."""
    records = run.records()
    names = dict.fromkeys(name for record in records for name in record)
    return pa.table({name: pa.array([record.get(name) for record in records]) for name in names})


def steps_table(run: Run) -> Any:
    """One row for each step of each stored episode, without pixels.

    Columns: iteration, episode, step; action, of several dimensions a list; reward; outputs, a list of |A|;
    terminated, of the episode's last step; inference_us and camera_to_action_us (null where no action came in
    time); weights_version; seed.
    """
    rows: list[Any] = []
    for episode in run.episodes():
        meta, steps = episode.meta, episode.steps
        waited_us = (episode.camera_to_action_ns / 1e3).tolist()
        rows.append(
            pa.table(
                {
                    "iteration": pa.array([meta.iteration] * steps, pa.int64()),
                    "episode": pa.array([meta.episode] * steps, pa.int64()),
                    "step": pa.array(range(steps), pa.int64()),
                    "action": pa.array(episode.actions.tolist()),
                    "reward": pa.array(episode.rewards),
                    "outputs": pa.array(episode.outputs.tolist()),
                    "terminated": pa.array([False] * (steps - 1) + [meta.terminated]),
                    "inference_us": pa.array(episode.inference_ns / 1e3),
                    "camera_to_action_us": pa.array([us or None for us in waited_us], pa.float64()),
                    "weights_version": pa.array([meta.weights_version] * steps, pa.int64()),
                    "seed": pa.array([meta.seed] * steps, pa.uint64()),
                }
            )
        )
    return pa.concat_tables(rows) if rows else pa.table({})


def write_csv(table: Any, path: Path) -> None:
    """Writes the columns that hold one number a row."""
    plain = [field.name for field in table.schema if not pa.types.is_nested(field.type)]
    pyarrow.csv.write_csv(table.select(plain), path)


def write_parquet(run: Run, folder: Path) -> list[Path]:
    """Writes both tables into a new folder."""
    tables = {"metrics.parquet": metrics_table(run), "steps.parquet": steps_table(run)}
    folder.mkdir(parents=True)
    for name, table in tables.items():
        pyarrow.parquet.write_table(table, folder / name)
    return [folder / name for name in tables]
