"""`bpn export`: a run or its policy in the formats of others, from the run's folder alone."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from bpn.export.formats import FORMATS, export
from bpn.options import add_runs_dir
from bpn.run import Version, open_run


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("run_id", metavar="RUN", help="id of the run, its end, or its folder")
    told = "; ".join(f"{name}: {form.help}" for name, form in FORMATS.items())
    parser.add_argument("--format", choices=FORMATS, required=True, help=told)
    parser.add_argument(
        "--output", type=Path, metavar="PATH",
        help="file, or a new folder for parquet and lerobot (default: named by the run, here)",
    )  # fmt: skip
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--version", type=int, help="weights version (default: the newest)")
    which.add_argument(
        "--best",
        action="store_true",
        help="the version that was the best in the evaluations during training",
    )
    parser.add_argument("--json", action="store_true", help="print the written files as JSON")
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Writes it, and prints the files."""
    found = open_run(options.run_id, runs_dir=options.runs_dir)
    version: Version = "best" if options.best else options.version
    written = export(found, options.format, options.output, version=version)
    if options.json:
        print(json.dumps([str(path) for path in written]))
    else:
        for path in written:
            print(path)
    return 0
