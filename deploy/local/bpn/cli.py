"""The `bpn` command."""

import argparse
import logging
import sys

from bpn.commands import bench, dashboard, doctor, evaluate, runs, train, up
from bpn.dashboard import DashboardAwayError, DashboardError
from bpn.local_run import RunFailedError
from bpn_shared.bnn.blob import BlobError
from bpn_shared.config import ConfigError

log = logging.getLogger("bpn")


def build_parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    parser = argparse.ArgumentParser(
        prog="bpn", description="Reinforcement learning of robot control with binarized networks."
    )
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (up, train, runs, evaluate, dashboard, bench, doctor):
        command.add(subparsers)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Runs one command. Exit status: 0 done, 1 failed, 2 wrong input, 130 interrupted."""
    logging.basicConfig(
        level=logging.WARNING, format="%(levelname)s %(message)s", stream=sys.stderr
    )
    options = build_parser().parse_args(argv)
    try:
        status: int = options.run(options)
        return status
    except (ConfigError, BlobError) as error:
        print(f"bpn: {error}", file=sys.stderr)
        return 2
    except (RunFailedError, DashboardError, DashboardAwayError) as error:
        print(f"bpn: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
