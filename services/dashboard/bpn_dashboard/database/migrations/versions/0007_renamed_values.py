"""Configuration values have the field's names, and hashes cover what is learned alone.

Rows of runs are made anew from their folders, by whoever starts with this schema: they have no hash until then.
"""

from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

_NAMES = {
    "nodes": "hidden_units",
    "batch": "batch_size",
    "datasets": "replay_iterations",
    "learning_rate_final": "lr_update_final_factor",
    "learning_rate_last": "lr_run_final_factor",
    "engine": "backend",
    "mask_terminals": "bootstrap_terminals",
}
_BACKENDS = {"fast": "native", "plain": "torch"}

_RUNS = sa.table("runs", sa.column("id"), sa.column("config", sa.JSON), sa.column("config_hash"))
_SWEEPS = sa.table(
    "sweeps", sa.column("id"), sa.column("config", sa.JSON), sa.column("grid", sa.JSON)
)


def upgrade() -> None:
    _rename(_NAMES, _BACKENDS)


def downgrade() -> None:
    _rename({new: old for old, new in _NAMES.items()}, {new: old for old, new in _BACKENDS.items()})


def _rename(names: dict[str, str], backends: dict[str, str]) -> None:
    def value(name: str, found: Any) -> Any:
        if name in ("engine", "backend"):
            return backends.get(found, found)
        return not found if name in ("mask_terminals", "bootstrap_terminals") else found

    def renamed(values: dict[str, Any], each: Callable[[str, Any], Any]) -> dict[str, Any]:
        return {names.get(name, name): each(name, found) for name, found in values.items()}

    connection = op.get_bind()
    for run in connection.execute(sa.select(_RUNS)).all():
        connection.execute(
            sa.update(_RUNS)
            .where(_RUNS.c.id == run.id)
            .values(config=renamed(run.config, value), config_hash="")
        )
    for sweep in connection.execute(sa.select(_SWEEPS)).all():
        grid = renamed(sweep.grid, lambda name, axis: [value(name, found) for found in axis])
        connection.execute(
            sa.update(_SWEEPS)
            .where(_SWEEPS.c.id == sweep.id)
            .values(config=renamed(sweep.config, value), grid=grid)
        )
