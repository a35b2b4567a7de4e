"""Sites: which workers are near each other. A robot and its edge are always of one site.

A worker's id tells its site, so whoever knows a worker, by its token, its telemetry or its question, knows where
it is; and a router knows by a certificate's name for which site it speaks.
"""

import re
from typing import Final

from bpn_shared.errors import InputError

MAIN_SITE: Final = "main"
"""Of workers that were not told theirs: those beside the router."""

LONGEST = 24
_NAME = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,22}[a-z0-9])?")


def check_name(name: str, what: str) -> str:
    """The name of a site or a machine, if it can be one: it becomes part of keys and certificates.

    Raises:
        InputError: it cannot; the message begins with `what`.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{what} = {name!r} must be 1 to {LONGEST} letters a-z, digits and dashes inside it"
        )
    return name


def site_of(worker: str) -> str:
    """The site that a worker's id tells."""
    site, dot, _ = worker.partition(".")
    return site if dot else MAIN_SITE


def prefix_of(site: str) -> str:
    """How the ids of a site's workers begin."""
    return "" if site == MAIN_SITE else f"{site}."
