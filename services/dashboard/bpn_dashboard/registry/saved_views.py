"""Views that people have named: files beside the run folders, as sweeps have them, which outlive the database."""

import logging
import threading
import time
from pathlib import Path
from typing import Annotated

import uuid_utils
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bpn_dashboard.registry.errors import RegistryError
from bpn_shared.runs.digests import DamagedError, seal, unseal
from bpn_shared.runs.files import write_atomically
from bpn_shared.runs.opening import file_names, read_file

log = logging.getLogger(__name__)

FOLDER = "views"
MOST = 500


class UnknownViewError(RegistryError):
    """There is no view of that id."""

    def __init__(self, view_id: str) -> None:
        super().__init__(f"there is no saved view {view_id}")


class TooManyViewsError(RegistryError):
    """No more can be saved."""


class SavedView(BaseModel):
    """A name for what an address of the page shows.

    Attributes:
        query: the address's part behind the question mark.
        by: who saved it last.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    id: str
    name: str
    query: str
    by: str
    saved_at: Annotated[float, Field(allow_inf_nan=False)]


class SavedViews:
    """The views of one runs directory. Its methods may be called from any thread."""

    def __init__(self, runs_dir: Path) -> None:
        self._runs_dir = runs_dir
        self._lock = threading.Lock()

    def all(self) -> list[SavedView]:
        """By name; files that cannot be read are left out, and told in the log."""
        found = (self._read(name) for name in file_names(self._runs_dir, FOLDER, suffix=".json"))
        return sorted(
            (view for view in found if view is not None), key=lambda v: (v.name.casefold(), v.id)
        )

    def save(self, name: str, query: str, by: str, view_id: str | None = None) -> SavedView:
        """A new view, or another content of a known one.

        Raises:
            UnknownViewError: there is none of that id.
            TooManyViewsError: there are as many as there may be.
            OSError: it cannot be written, as on a full disk.
        """
        with self._lock:
            if view_id is None:
                if len(file_names(self._runs_dir, FOLDER, suffix=".json")) >= MOST:
                    raise TooManyViewsError(f"there are {MOST} saved views: delete one before")
                view_id = str(uuid_utils.uuid7())
            else:
                self._known(view_id)
            view = SavedView(id=view_id, name=name, query=query, by=by, saved_at=time.time())
            path = self._path(view_id)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, seal(view.model_dump()), root=self._runs_dir)
        return view

    def delete(self, view_id: str) -> None:
        """Forgets a view.

        Raises:
            UnknownViewError: there is none of that id.
        """
        with self._lock:
            self._known(view_id).unlink()

    def _known(self, view_id: str) -> Path:
        if f"{view_id}.json" not in file_names(self._runs_dir, FOLDER, suffix=".json"):
            raise UnknownViewError(view_id)
        return self._path(view_id)

    def _path(self, view_id: str) -> Path:
        return self._runs_dir / FOLDER / f"{view_id}.json"

    def _read(self, name: str) -> SavedView | None:
        try:
            view = SavedView.model_validate(
                unseal(read_file(self._runs_dir, f"{FOLDER}/{name}"))[0]
            )
        except (OSError, DamagedError, ValidationError) as error:
            log.warning("a saved view cannot be read: %s", error)
            return None
        return view if name == f"{view.id}.json" else None
