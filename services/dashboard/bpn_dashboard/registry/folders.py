"""From run folders to rows: what a folder says about its run, all of it."""

import contextlib
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from uuid import UUID

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.database.text_keys import visible
from bpn_dashboard.registry.about import About
from bpn_dashboard.registry.errors import UnknownRunError
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.registry.states import observed
from bpn_shared.runs.config_file import config_hash
from bpn_shared.runs.folder import RunFolder, is_run_id
from bpn_shared.runs.trash import Removed, Trash
from bpn_shared.spec.config import ConfigError
from bpn_shared.spec.tasks import RETURN

_FILES = ("config.json", "state.json", "about.json")
_NEEDED: dict[str, tuple[type, int]] = {
    "seed": (int, 0), "iterations": (int, 1), "robots": (int, 1), "steps": (int, 1),
}  # fmt: skip
"""What the dashboard itself takes from a configuration: type, and least value."""

Signature = tuple[tuple[int, int, int] | None, ...]
"""Of a folder's files, what changes when one is replaced: inode, size, time of its last change."""


def signature(folder: RunFolder) -> Signature:
    """Tells whether a folder that could not be read has been changed since."""

    def of(name: str) -> tuple[int, int, int] | None:
        try:
            status = os.lstat(folder.path / name)
        except OSError:
            return None
        return status.st_ino, status.st_size, status.st_mtime_ns

    return tuple(of(name) for name in _FILES)


def candidates(runs_dir: Path) -> Iterator[RunFolder]:
    """What is or may become the folder of a run, oldest first: whatever is named by a UUID."""
    for path in sorted(runs_dir.iterdir()) if runs_dir.is_dir() else ():
        with contextlib.suppress(ValueError):
            UUID(path.name)
            yield RunFolder(path)


def why_none(folder: RunFolder) -> str | None:
    """What keeps something that is named by a UUID from being a run's folder; None: nothing."""
    if not is_run_id(folder.path.name):
        return f"{folder.path}: the run's id in another spelling, a copy? It is ignored"
    if folder.path.is_symlink():
        return f"{folder.path}: a link, which is not followed"
    if folder.is_complete():
        return None
    missing = [name for name in _FILES[:2] if not folder.has(name)]
    return f"{folder.path}: {' and '.join(missing) or 'a file'} is not there, or not yet"


@contextlib.contextmanager
def there(run_id: str) -> Iterator[None]:
    """A run whose folder the body does not find has just been removed.

    Raises:
        UnknownRunError: it was.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise UnknownRunError(run_id) from error


def name_of(about: About, values: Mapping[str, Any]) -> str:
    """The name of a run: what people call it, or what its configuration says most of."""
    task, algorithm, seed = (values.get(key, "?") for key in ("task", "algorithm", "seed"))
    return visible(about.name) or f"{task} {algorithm} seed {seed}"


def named_contents(trash: Trash) -> list[tuple[Removed, str]]:
    """What is in the trash, those removed last first, each with its name."""
    return [(removed, name_in_trash(trash, removed.run)) for removed in trash.contents()]


def name_in_trash(trash: Trash, run_id: str) -> str:
    """The name of a removed run, as far as its files tell."""
    folder, about = RunFolder(trash.path / run_id), About()
    with contextlib.suppress(ConfigError):
        about = About.read(folder)
    return name_of(about, folder.raw_config())


BY_VALUE = frozenset({"task_spec", "algorithm_spec"})
"""What a row has the name of alone."""


def _hash_of_values(values: Mapping[str, Any]) -> str:
    """In place of `config_hash`, for a configuration that cannot be read: nobody knows what it means."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def row_of(folder: RunFolder, about: About | None = None) -> RunRow:
    """The row of a run.

    One whose configuration this program cannot read, as of a newer version, is shown as far as it can be, with
    the reason as its error; no worker gets it.

    Args:
        about: what people say about it; None: what its folder says that they do.

    Raises:
        ConfigError: a file of the folder is missing or damaged.
    """
    about, now_s = about or About.read(folder), time.time()
    recorded = folder.state()
    written_s = (folder.path / "state.json").stat().st_mtime
    try:
        config = folder.config()
        values, error = config.model_dump(mode="json", exclude=set(BY_VALUE)), recorded.error
        metric, hash_ = config.task_spec.return_metric, config_hash(config)
    except ConfigError as unreadable:
        values, error = _shown_at_least(folder, unreadable), str(unreadable)
        metric, hash_ = RETURN, _hash_of_values(values)
        about = about.model_copy(update={"desired_state": "stopped"})
    return RunRow(
        id=str(folder.run),
        task=values["task"],
        algorithm=values["algorithm"],
        seed=values["seed"],
        config=values,
        config_hash=hash_,
        state=observed(
            recorded.state, about.desired_state, owned=False, elsewhere=folder.is_owned()
        ),
        attempt=recorded.attempt,
        iterations=values["iterations"],
        return_metric=metric,
        error=error,
        created_at=min(recorded.created_unix_s, now_s),  # of a clock that goes fast
        updated_at=min(recorded.updated_unix_s or written_s, now_s),  # which a copy does not change
        folder_at=written_s,
        **about.columns(),
        name=name_of(about, values),
        **Progress(folder).read(),
    )


def _shown_at_least(folder: RunFolder, unreadable: ConfigError) -> dict[str, Any]:
    """The values of a configuration that cannot be read, if they are enough for a row."""
    values = {key: v for key, v in folder.raw_config().items() if key not in BY_VALUE}
    texts = all(isinstance(values.get(name), str) for name in ("task", "algorithm"))
    numbers = all(
        type(values.get(name)) is kind and least <= values[name] < 2**63
        for name, (kind, least) in _NEEDED.items()
    )
    if not (texts and numbers):
        raise unreadable
    return values
