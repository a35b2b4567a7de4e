"""Which run is meant by the beginning or the end of its id."""

from collections.abc import Sequence
from pathlib import Path

from bpn_shared.runs.trash import Trash
from bpn_shared.spec.config import ConfigError

_MOST_LISTED = 5


def whole_id(runs_dir: Path, names: Sequence[str], part: str) -> str:
    """The one of the runs' ids that begins or ends like this.

    Args:
        names: of all runs in `runs_dir`, oldest first.

    Raises:
        ConfigError: none does, or several; the message says which there are, or that it is in the trash.
    """
    matches = _alike(names, part)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise ConfigError(
            f"{len(matches)} runs in {runs_dir} match {part!r}: {_listed(matches)}; give more of the id's end, "
            "since ids of one time begin alike"
        )
    for name in _alike(Trash(runs_dir).names(), part):
        raise ConfigError(f"run {name} is in the trash: `bpn runs restore {name}` brings it back")
    there = f"the newest are: {_listed(names)}" if names else "there are none"
    raise ConfigError(f"no run in {runs_dir} matches {part!r}; {there}")


def _alike(names: Sequence[str], part: str) -> list[str]:
    return [name for name in names if name.startswith(part) or name.endswith(part)]


def _listed(names: Sequence[str]) -> str:
    newest, older = names[-_MOST_LISTED:], len(names) - _MOST_LISTED
    return ", ".join(newest) + (f" and {older} more" if older > 0 else "")
