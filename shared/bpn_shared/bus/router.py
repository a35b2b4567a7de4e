"""`bpn-router`: a Zenoh router in Python, a drop-in for the official one."""

import argparse
import json
import logging
import threading
import time
from pathlib import Path, PurePosixPath

import zenoh

from bpn_shared.backoff import Backoff
from bpn_shared.bus.address import is_loopback
from bpn_shared.bus.admitted import AdmittedWatch
from bpn_shared.bus.certificates import CertificateError, CertificateFiles
from bpn_shared.bus.endpoint import check_endpoint
from bpn_shared.bus.obstacle import obstacle, own_obstacle, plain
from bpn_shared.bus.renewal import CertificateWatch
from bpn_shared.bus.router_config import SECURE_ENDPOINT, admitting, at_site, bare, secure
from bpn_shared.bus.session import DEFAULT_ENDPOINT, prepare_process
from bpn_shared.bus.session_shares import SessionShares
from bpn_shared.bus.upstream import UpstreamLine
from bpn_shared.counters import Counters
from bpn_shared.errors import InputError
from bpn_shared.runtime.heartbeat import Heartbeat
from bpn_shared.runtime.service import end_with_supervisor, set_up_logging, stop_on_signals
from bpn_shared.spec.config import ConfigError
from bpn_shared.version_option import add_version_option

log = logging.getLogger("bpn_router")

PERIOD_S = 2.0
"""How often the router looks at its certificates, who is admitted, and whether it can be reached."""
_LISTEN_S = 5.0
_EXIT_WRONG_INPUT = 2  # as every service's; the supervisor does not try it again


def configure(
    endpoint: str | None = None,
    config_file: Path | None = None,
    upstream: str | None = None,
    *,
    certificates: Path | None = None,
) -> zenoh.Config:
    """The configuration of a router that nobody can use who should not.

    Args:
        endpoint: where it listens; None: where the file says, or the default.
        config_file: a Zenoh JSON5 file; None: a router without authentication, for this machine only.
        upstream: another router, with which this one makes one bus.
        certificates: in place of a file, the folder with the router's certificates: others reach it over TLS, and
            each role may do what the table of access says. One that listens for this machine alone asks nobody,
            and shows them to the other router that it joins.

    Raises:
        InputError: an endpoint or the file is none, or others could reach it and it asks for no certificates.
    """
    if certificates is not None:
        files = CertificateFiles.in_folder(certificates)
        if reason := own_obstacle(files):
            raise CertificateError(f"{reason}; `bpn-certificates` makes what a router needs")
        folder = PurePosixPath(certificates.absolute())
        if upstream is not None and endpoint is not None and is_local(endpoint):
            form = at_site(upstream, folder)
        else:
            form = secure(endpoint or SECURE_ENDPOINT, folder)
        config = zenoh.Config.from_json5(json.dumps(form))
    elif config_file is None:
        config = zenoh.Config.from_json5(json.dumps(bare()))
        endpoint = endpoint or DEFAULT_ENDPOINT
    else:
        config = _from_file(config_file)
    if endpoint is not None:
        check_endpoint(endpoint)
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    if upstream is not None:
        check_endpoint(upstream)
        config.insert_json5("connect/endpoints", json.dumps([upstream]))
    asks_who = json.loads(config.get_json("transport/link/tls"))["enable_mtls"]
    for open_door in filter(lambda e: not is_local(e), endpoints(config)):
        if not (open_door.startswith(("tls/", "quic/")) and asks_who):
            raise ConfigError(
                f"{open_door} can be reached from other machines, and nobody would be asked who they are: "
                "listen on loopback, or on tls/ with --certificates (or a file like deploy/router/router.json5)"
            )
    return config


def _from_file(path: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        raise InputError(f"{path}: {plain(error)}") from error


def endpoints(config: zenoh.Config) -> list[str]:
    """Where a router of this configuration listens."""
    listen = json.loads(config.get_json("listen/endpoints"))
    if isinstance(listen, dict):  # a list for each mode
        listen = listen.get("router", [])
    return [listen] if isinstance(listen, str) else list(listen)


def is_local(endpoint: str) -> bool:
    """Whether only this machine can reach an endpoint."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.rpartition(":")[0].strip("[]")
    return is_loopback(host)


def certificate_files(config: zenoh.Config) -> CertificateFiles | None:
    """The files that a router of this configuration shows to others; None: it shows none."""
    tls = json.loads(config.get_json("transport/link/tls"))
    for end in ("listen", "connect"):
        names = ("root_ca_certificate", f"{end}_certificate", f"{end}_private_key")
        if all(files := [tls.get(name) for name in names]):
            return CertificateFiles(*map(Path, files))
    return None


def upstream_of(config: zenoh.Config) -> str | None:
    """The other router that one of this configuration joins."""
    joined = json.loads(config.get_json("connect/endpoints"))
    if isinstance(joined, dict):
        joined = joined.get("router", [])
    return joined[0] if joined else None


def serve(
    config: zenoh.Config, stop: threading.Event, heartbeat: Heartbeat, period_s: float = PERIOD_S
) -> None:
    """Routes until `stop` is set, with a new session whenever there are new certificates, or others are admitted:
    Zenoh reads both once.

    Raises:
        zenoh.ZError: it cannot listen.
    """
    files = certificate_files(config)
    watch = None if files is None else CertificateWatch(files)
    rules = json.loads(config.get_json("access_control"))
    admitted = AdmittedWatch(files.certificate.parent if files and rules["enabled"] else None)
    line = UpstreamLine(upstream_of(config), files)
    door, ready = _own_door(endpoints(config)[0]), True
    share, counters = _share(config), Counters()
    heartbeat.ready_when(lambda: ready)
    log.info("router listens at %s", ", ".join(endpoints(config)))
    while not stop.is_set():
        config.insert_json5("access_control", json.dumps(admitting(rules, admitted.machines)))
        with _listening(config, stop) as session, SessionShares(session, share, counters):
            while not stop.is_set():
                ready = not obstacle(door, files, any_name=True)
                line.look(session)
                if admitted.changed():
                    log.info(
                        "%d machines are admitted: everyone connects anew", len(admitted.machines)
                    )
                    break
                if watch is not None:
                    watch.warn()
                    if watch.renewed():
                        log.info("there are new certificates: everyone connects anew")
                        break
                stop.wait(period_s)


def _share(config: zenoh.Config) -> int:
    """The sessions that one certificate may have: half, so that it keeps nobody else out."""
    return max(1, int(json.loads(config.get_json("transport/unicast/max_sessions"))) // 2)


def _listening(config: zenoh.Config, stop: threading.Event) -> zenoh.Session:
    """A session; where one was before, its port may take a moment to be free."""
    backoff, deadline_s = Backoff(), time.monotonic() + _LISTEN_S
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if time.monotonic() > deadline_s or stop.wait(backoff.next_s()):
                raise


def _own_door(endpoint: str) -> str:
    """The endpoint as this machine reaches it, if it listens at every address."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def main(argv: list[str] | None = None) -> int:
    """Runs the router until SIGINT or SIGTERM. Exit status: 0 stopped, 2 it cannot listen there."""
    parser = argparse.ArgumentParser(prog="bpn-router", description=__doc__)
    add_version_option(parser)
    parser.add_argument(
        "--listen", help=f"endpoint (default: as the file says, else {DEFAULT_ENDPOINT})"
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--config", type=Path, help="Zenoh JSON5 file (default: for this machine)")
    how.add_argument(
        "--certificates", type=Path, metavar="FOLDER",
        help="the router's certificates, with which others may reach it, each to do what its role may",
    )  # fmt: skip
    parser.add_argument("--upstream", metavar="ENDPOINT", help="another site's router to join")
    options = parser.parse_args(argv)
    set_up_logging("router")
    prepare_process()
    stop = stop_on_signals()
    end_with_supervisor()
    try:
        config = configure(
            options.listen, options.config, options.upstream, certificates=options.certificates
        )
        with Heartbeat(lambda: False) as heartbeat:
            serve(config, stop, heartbeat)
    except (InputError, zenoh.ZError) as error:
        where = options.listen or "its endpoint"
        log.error("the router cannot listen at %s: %s", where, plain(error))
        return _EXIT_WRONG_INPUT
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
