"""Prints every fault; exit status 1 if there is one."""

import sys
from itertools import chain
from pathlib import Path

from checks import claims, links, pages, shapes


def main(root: Path) -> int:
    """Checks figures, links, result pages and generated headers of the repository at `root`."""
    faults = list(
        chain(claims.check(root), links.check(root), pages.check(root), shapes.check(root))
    )
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main(Path.cwd()))
