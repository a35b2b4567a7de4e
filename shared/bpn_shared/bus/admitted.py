"""Which machines a router admits beside the roles: a file in its folder of certificates, by common names.

It is the list that decides: who is taken off it can do nothing any more, however long its certificate is good.
"""

import json
import logging
from pathlib import Path

from bpn_shared.bus.identity import Identity

log = logging.getLogger(__name__)

ADMITTED = "admitted.json"
MAX_MACHINES = 1000
_MAX_BYTES = 256 * 1024


class AdmittedError(ValueError):
    """The file is none; the message says what is wrong with it."""


def read_admitted(folder: Path) -> tuple[Identity, ...]:
    """The machines that the router with these certificates admits; none where there is no file.

    Raises:
        AdmittedError: the file is no such list.
        OSError: it cannot be read.
    """
    try:
        with (folder / ADMITTED).open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
    except FileNotFoundError:
        return ()
    try:
        names = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise AdmittedError(f"{folder / ADMITTED} is no JSON") from error
    if not isinstance(names, list) or len(names) > MAX_MACHINES:
        raise AdmittedError(
            f"{folder / ADMITTED} must be a list of at most {MAX_MACHINES} common names"
        )
    identities = [Identity.parse(name) if isinstance(name, str) else None for name in names]
    if None in identities:
        wrong = names[identities.index(None)]
        raise AdmittedError(f"{folder / ADMITTED}: {wrong!r} is no machine's common name")
    return tuple(identity for identity in identities if identity is not None)


class AdmittedWatch:
    """Looks from time to time who is admitted.

    Args:
        folder: the router's certificates; None: it admits nobody.

    Attributes:
        machines: as last read; a file that cannot be read changes nothing.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._said = ""
        self.machines: tuple[Identity, ...] = ()
        self.changed()

    def changed(self) -> bool:
        """Whether there are others than before."""
        if self._folder is None:
            return False
        try:
            found, trouble = read_admitted(self._folder), ""
        except (AdmittedError, OSError) as error:
            found, trouble = self.machines, str(error)
        if trouble and trouble != self._said:
            log.error("who is admitted stays as it was: %s", trouble)
        self._said = trouble
        changed, self.machines = found != self.machines, found
        return changed
