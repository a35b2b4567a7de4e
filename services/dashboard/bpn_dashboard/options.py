"""The options of `bpn-dashboard`, and which combinations are refused."""

import argparse
import re
import ssl
from pathlib import Path
from urllib.parse import urlsplit

from bpn_dashboard.alerts.webhook import Webhook
from bpn_dashboard.database.engine import sqlite_url
from bpn_dashboard.registry.retention import Rule
from bpn_shared.bus.address import is_loopback
from bpn_shared.bus.certificates import client_tls
from bpn_shared.bus.endpoint import check_endpoint
from bpn_shared.bus.session import DEFAULT_ENDPOINT
from bpn_shared.runs.trash import KEPT_DAYS
from bpn_shared.spec.config import ConfigError
from bpn_shared.version_option import add_version_option

DEFAULT_PORT = 8000
DATABASE_FILE = ".dashboard.sqlite"


def argument_parser() -> argparse.ArgumentParser:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="bpn-dashboard",
        description="Runs, their registry, the live view and the web UI, in one process.",
    )
    add_version_option(parser)
    parser.add_argument(
        "--runs-dir", type=Path, default=Path("runs"), help="where run folders are (default runs)"
    )
    parser.add_argument(
        "--state-dir",
        type=Path,
        metavar="DIR",
        help="where its database is and the token for this user's commands (default: the runs folder, "
        "in which learners of the same user may read them)",
    )
    parser.add_argument(
        "--database", metavar="URL", help="SQLAlchemy URL (default: SQLite in the state folder)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (%(default)s)")
    parser.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="0: any free one (%(default)s)"
    )
    parser.add_argument(
        "--connect", default=DEFAULT_ENDPOINT, help="the router's endpoint (default %(default)s)"
    )
    parser.add_argument(
        "--allow-host", action="append", default=[], metavar="NAME",
        help="another name by which browsers reach it; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--public-url",
        metavar="URL",
        help="where browsers reach it, if that is not --host and --port: a published port, a proxy",
    )
    parser.add_argument(
        "--first-run",
        metavar="TASK",
        default="",
        help="start a run of this task if there is no run yet",
    )
    parser.add_argument("--certificate", type=Path, help="TLS certificate, PEM")
    parser.add_argument("--key", type=Path, help="its private key, PEM")
    parser.add_argument(
        "--insecure-http", action="store_true", help="beyond loopback without TLS, at your own risk"
    )
    parser.add_argument(
        "--open-metrics", action="store_true", help="/metrics needs no token from loopback"
    )
    parser.add_argument(
        "--metrics-token",
        type=Path,
        metavar="FILE",
        help="write a token for who reads /metrics here",
    )
    parser.add_argument(
        "--alert-webhook",
        metavar="URL",
        help="where alerts are sent by POST, signed: failed and stalled runs, silent robots, fallen returns",
    )
    parser.add_argument(
        "--alert-secret", type=Path, metavar="FILE", help="the secret that signs them"
    )
    parser.add_argument(
        "--trash-days",
        type=float,
        default=KEPT_DAYS,
        metavar="DAYS",
        help="how long removed runs can be restored (default %(default)g)",
    )
    parser.add_argument(
        "--keep-runs",
        type=int,
        metavar="N",
        help="move runs behind the N newest to the trash, as `bpn runs prune --keep` does (default: all stay)",
    )
    parser.add_argument(
        "--keep-days",
        type=float,
        metavar="DAYS",
        help="and those to which nothing has happened for so long; with both, those that both mean",
    )
    return parser


def retention(options: argparse.Namespace) -> Rule | None:
    """The rule by which runs go to the trash; None: none do."""
    if options.keep_runs is None and options.keep_days is None:
        return None
    return Rule(options.keep_runs, options.keep_days)


def webhook(options: argparse.Namespace) -> Webhook | None:
    """Where alerts go; None: nowhere but to open pages.

    Raises:
        ConfigError: half of it is missing, or wrong.
    """
    if (options.alert_webhook is None) != (options.alert_secret is None):
        raise ConfigError("--alert-webhook and --alert-secret belong together")
    if options.alert_webhook is None:
        return None
    return Webhook.read(options.alert_webhook, options.alert_secret)


def database_url(state_dir: Path, url: str | None = None) -> str:
    """The database of a URL, or the one in the state folder."""
    return url or sqlite_url(state_dir / DATABASE_FILE)


def state_dir(options: argparse.Namespace) -> Path:
    """Where the dashboard keeps what is its alone."""
    folder: Path = options.state_dir or options.runs_dir
    return folder


def is_secure(options: argparse.Namespace) -> bool:
    """Whether browsers speak TLS with it, or with a proxy before it."""
    behind_tls = (options.public_url or "").startswith("https:")
    return behind_tls or options.certificate is not None


def check_options(options: argparse.Namespace) -> None:
    """Refuses what would let others listen in.

    Raises:
        ConfigError: the combination is wrong; the message says what to do.
    """
    if not 0 <= options.trash_days < 1e6:
        raise ConfigError(f"--trash-days {options.trash_days}: must be 0 or more days")
    if (rule := retention(options)) is not None:
        rule.check()
    webhook(options)
    if (options.certificate is None) != (options.key is None):
        raise ConfigError("--certificate and --key belong together")
    if options.certificate is not None:
        _check_certificate(options.certificate, options.key)
    check_endpoint(options.connect)
    client_tls(options.connect)  # the router's, which would be missed much later
    secure = options.certificate is not None or options.insecure_http
    if options.public_url is not None and not _is_public_url(options.public_url):
        raise ConfigError(
            f"--public-url {options.public_url}: must be scheme, name and port, such as http://localhost:8000, "
            "and where a proxy has it below a path that path without a slash at its end"
        )
    if not is_loopback(options.host) and not secure:
        raise ConfigError(
            f"--host {options.host}: others could read sessions off the network. Give --certificate and "
            "--key, or --insecure-http if you mean it"
        )


_PATH = re.compile(r"(/[A-Za-z0-9._~-]+)*")


def _is_public_url(url: str) -> bool:
    """Whether it is scheme and authority, with a plain path or without one, and nothing else."""
    try:
        parts = urlsplit(url)
        return (
            parts.port != 0
            and bool(parts.hostname)
            and parts.username is None
            and url in {f"{scheme}://{parts.netloc}{parts.path}" for scheme in ("http", "https")}
            and _PATH.fullmatch(parts.path) is not None
            and not {".", ".."} & set(parts.path.split("/"))
        )
    except ValueError:  # its port is no number
        return False


def _check_certificate(certificate: Path, key: Path) -> None:
    for path in (certificate, key):
        if not path.is_file():
            raise ConfigError(f"{path}: there is no such file")
    try:
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key)
    except OSError as error:  # ssl.SSLError is one
        raise ConfigError(
            f"--certificate {certificate} --key {key} are no PEM certificate with its key: {error}"
        ) from error
