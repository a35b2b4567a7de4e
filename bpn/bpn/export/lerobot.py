"""A run's episodes as a LeRobot dataset, codebase version v3.0: frames as PNG, so that nothing is lost.

Frame t has the action that was applied after it and that action's reward. An episode's last picture, to which no
action belongs, is left out.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pandas
import pyarrow as pa
import pyarrow.parquet

from bpn.run import Run
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.tasks import TaskSpec

CODEBASE_VERSION = "v3.0"
CAMERA = "observation.images.camera"
_DATA, _EPISODES = "data", "meta/episodes"
_FILE = "chunk-{chunk:03d}/file-{file:03d}.parquet"
_FILE_BYTES = 100 * 2**20
_FILES_PER_CHUNK = 1000
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)

Values = dict[str, npt.NDArray[Any]]
"""Of an episode's frames, by feature; pictures uint8[T, height, width, 3]."""


def write(run: Run, folder: Path) -> list[Path]:
    """Writes the dataset into a new folder.

    Raises:
        InputError: the run has no episodes yet.
    """
    task = run.config.task_spec
    dataset = _Dataset(folder, task)
    for episode in run.episodes():
        dataset.add(episode)
    if not dataset.episodes:
        raise InputError(f"run {run.id} has no episodes yet")
    return dataset.close(run)


@dataclass
class _Dataset:
    """A dataset in the making."""

    folder: Path
    task: TaskSpec
    frames: int = 0
    episodes: list[dict[str, Any]] = field(default_factory=list)
    seen: dict[str, "_Moments"] = field(default_factory=dict)
    written: list[Path] = field(default_factory=list)
    _pending: list[pa.Table] = field(default_factory=list)
    _pending_bytes: int = 0

    def add(self, episode: Episode) -> None:
        """Appends an episode."""
        values = _values(episode, self.task, len(self.episodes), self.frames)
        pictures = [_png(picture) for picture in values[CAMERA]]
        stats = {name: _Moments.of(name, found) for name, found in values.items()}
        for name, moments in stats.items():
            self.seen[name] = self.seen[name].joined(moments) if name in self.seen else moments
        size = sum(map(len, pictures))
        if self._pending and self._pending_bytes + size > _FILE_BYTES:
            self._flush()
        chunk, file = self._place
        self.episodes.append(
            {
                "episode_index": len(self.episodes),
                "tasks": [self._sentence],
                "length": episode.steps,
                "dataset_from_index": self.frames,
                "dataset_to_index": self.frames + episode.steps,
                "data/chunk_index": chunk,
                "data/file_index": file,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{
                    f"stats/{name}/{what}": value
                    for name, moments in stats.items()
                    for what, value in moments.shown().items()
                },
            }
        )
        self._pending.append(_table(values, pictures))
        self._pending_bytes += size
        self.frames += episode.steps

    def close(self, run: Run) -> list[Path]:
        """Writes what remains and what describes it."""
        self._flush()
        self._parquet(
            f"{_EPISODES}/{_FILE.format(chunk=0, file=0)}", pa.Table.from_pylist(self.episodes)
        )
        tasks = self._new("meta/tasks.parquet")
        pandas.DataFrame({"task_index": [0]}, index=[self._sentence]).to_parquet(tasks)
        stats = {name: moments.shown() for name, moments in self.seen.items()}
        self._json("meta/stats.json", stats)
        self._json("meta/info.json", self._info())
        self._json("meta/bpn.json", _origin(run))
        return self.written

    @property
    def _sentence(self) -> str:
        return self.task.title or self.task.name

    @property
    def _place(self) -> tuple[int, int]:
        return divmod(len(self.written), _FILES_PER_CHUNK)

    def _flush(self) -> None:
        if not self._pending:
            return
        chunk, file = self._place
        self._parquet(
            f"{_DATA}/{_FILE.format(chunk=chunk, file=file)}", pa.concat_tables(self._pending)
        )
        self._pending, self._pending_bytes = [], 0

    def _parquet(self, name: str, table: pa.Table) -> None:
        pyarrow.parquet.write_table(table, self._new(name))

    def _json(self, name: str, values: Any) -> None:
        self._new(name).write_text(json.dumps(values, indent=4))

    def _new(self, name: str) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        self.written.append(path)
        return path

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": CODEBASE_VERSION,
            "robot_type": self.task.robot,
            "total_episodes": len(self.episodes),
            "total_frames": self.frames,
            "total_tasks": 1,
            "chunks_size": _FILES_PER_CHUNK,
            "data_files_size_in_mb": _FILE_BYTES // 2**20,
            "video_files_size_in_mb": 200,
            "fps": _fps(self.task),
            "splits": {"train": f"0:{len(self.episodes)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": features(self.task),
        }


def features(task: TaskSpec) -> dict[str, dict[str, Any]]:
    """What every frame has: type, shape, names of dimensions."""
    _, height, width = task.frame_shape
    one = {"shape": [1], "names": None}
    numbers = {name: {"dtype": "int64", **one} for name in _INDICES}
    return {
        CAMERA: {
            "dtype": "image",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
        },
        "action": {"dtype": "int64", "shape": [len(task.dims)], "names": _action_names(task)},
        "next.reward": {"dtype": "float32", **one},
        "next.done": {"dtype": "bool", **one},
        "timestamp": {"dtype": "float32", **one},
        **numbers,
    }


def _action_names(task: TaskSpec) -> list[str]:
    return ["action"] if len(task.dims) == 1 else [f"action_{d}" for d in range(len(task.dims))]


_INDICES = ("frame_index", "episode_index", "index", "task_index")


def _fps(task: TaskSpec) -> float:
    """Frames a second; a whole number where it is one, as readers expect."""
    fps = 1 / task.control_period_s
    return round(fps) if abs(fps - round(fps)) < 1e-9 else fps


def _values(episode: Episode, task: TaskSpec, index: int, first: int) -> Values:
    steps = np.arange(episode.steps)
    pictures = np.moveaxis(episode.frames[:-1], 1, -1)
    return {
        CAMERA: np.broadcast_to(pictures, (*pictures.shape[:3], 3)),
        "action": episode.actions.astype(np.int64),
        "next.reward": episode.rewards.astype(np.float32),
        "next.done": steps == episode.steps - 1,
        "timestamp": (steps / _fps(task)).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full(episode.steps, index),
        "index": first + steps,
        "task_index": np.zeros(episode.steps, np.int64),
    }


def _table(values: Values, pictures: list[bytes]) -> pa.Table:
    images = pa.StructArray.from_arrays(
        [pa.array(pictures, pa.binary()), pa.nulls(len(pictures), pa.string())], ["bytes", "path"]
    )
    columns = {name: _column(found) for name, found in values.items() if name != CAMERA}
    return pa.table({CAMERA: images, **columns})


def _column(values: npt.NDArray[Any]) -> pa.Array:
    """Of numbers; of several a frame, lists of that length."""
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _png(picture: npt.NDArray[np.uint8]) -> bytes:
    written, encoded = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    if not written:
        raise InputError(f"OpenCV could not write a picture of {picture.shape} as PNG")
    found: bytes = encoded.tobytes()
    return found


@dataclass(frozen=True)
class _Moments:
    """Statistics of a feature; of pictures for each channel, of levels from 0 to 1."""

    shape: tuple[int, ...]
    count: int
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    mean: npt.NDArray[np.float64]
    variance: npt.NDArray[np.float64]
    quantiles: npt.NDArray[np.float64]

    @classmethod
    def of(cls, name: str, values: npt.NDArray[Any]) -> "_Moments":
        is_picture = name == CAMERA
        rows = values.reshape(-1, 3) / 255.0 if is_picture else values.reshape(len(values), -1)
        rows = rows.astype(np.float64)
        return cls(
            (3, 1, 1) if is_picture else (rows.shape[1],),
            len(values),
            rows.min(axis=0),
            rows.max(axis=0),
            rows.mean(axis=0),
            rows.var(axis=0),
            np.quantile(rows, _QUANTILES, axis=0),
        )

    def joined(self, other: "_Moments") -> "_Moments":
        """Of both together; quantiles are the two's means, weighted by their counts, as LeRobot joins them."""
        count = self.count + other.count
        share = other.count / count
        apart = other.mean - self.mean
        return _Moments(
            self.shape,
            count,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            self.mean + share * apart,
            (1 - share) * self.variance + share * other.variance + share * (1 - share) * apart**2,
            (1 - share) * self.quantiles + share * other.quantiles,
        )

    def shown(self) -> dict[str, Any]:
        """As lists, by the names that LeRobot has for them."""
        found = {
            "min": self.low,
            "max": self.high,
            "mean": self.mean,
            "std": np.sqrt(self.variance),
            **{f"q{100 * q:02.0f}": row for q, row in zip(_QUANTILES, self.quantiles, strict=True)},
        }
        return {name: value.reshape(self.shape).tolist() for name, value in found.items()} | {
            "count": [self.count]
        }


def _origin(run: Run) -> dict[str, Any]:
    """What LeRobot has no place for."""
    task = run.config.task_spec
    return {
        "run": run.id,
        "task": task.name,
        "action_names": list(task.action_names),
        "action_dims": list(task.dims),
        "reward_unit": task.reward_unit,
        "frames_stacked": task.frames_stacked,
    }
