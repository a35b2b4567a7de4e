"""From run folders to rows: what a folder says about its run, all of it."""

import hashlib
import json
import logging
from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

from bpn_dashboard.database.tables import RunRow
from bpn_dashboard.registry.about import About
from bpn_dashboard.registry.progress import Progress
from bpn_dashboard.registry.states import observed
from bpn_shared.runs.folder import RunFolder

log = logging.getLogger(__name__)


def run_folders(runs_dir: Path) -> Iterator[RunFolder]:
    """The run folders in a directory, oldest first (their names sort by time)."""
    for path in sorted(runs_dir.iterdir()) if runs_dir.exists() else ():
        try:
            UUID(path.name)
        except ValueError:
            continue
        if (path / "state.json").exists():  # written last when a folder is made
            yield RunFolder(path)


def row_of(folder: RunFolder, about: About | None = None) -> RunRow:
    """The row of a run.

    Args:
        about: what people say about it; None: what its folder says that they do.

    Raises:
        ConfigError: a file of the folder is missing or damaged.
    """
    about = about or About.read(folder)
    config, recorded = folder.config(), folder.state()
    values = config.model_dump()
    return RunRow(
        id=str(folder.run),
        task=config.task,
        algorithm=config.algorithm,
        seed=config.seed,
        config=values,
        config_hash=hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest(),
        state=observed(
            recorded.state, about.desired_state, owned=False, elsewhere=folder.is_owned()
        ),
        attempt=recorded.attempt,
        iterations=config.iterations,
        error=recorded.error,
        created_at=recorded.created_unix_s,
        updated_at=(folder.path / "state.json").stat().st_mtime,
        **about.model_dump(exclude={"name"}),
        name=about.name or f"{config.task} {config.algorithm} seed {config.seed}",
        **Progress(folder).read(),
    )
