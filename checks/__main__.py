"""Prints every fault; exit status 1 if there is one."""

import sys
from itertools import chain
from pathlib import Path

from checks import claims, links, pages, shapes, versions


def main(root: Path) -> int:
    """Checks figures, links, result pages, generated headers and versions of the repository at `root`."""
    checked = (claims, links, pages, shapes, versions)
    faults = list(chain.from_iterable(check.check(root) for check in checked))
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main(Path.cwd()))
