"""A router with certificates and access control in a process of its own, and sessions of every role."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import PurePosixPath

import pytest
from secure_router import SecureRouter

from bpn_certificates import authority as x509
from bpn_certificates.authority import Validity
from bpn_certificates.folders import make
from bpn_shared.bus.router_config import render, secure
from bpn_shared.bus.session import Bus

OBSERVER = "observer"
"""Sees and may do everything, so that it can tell what got through; only this router knows it."""


@pytest.fixture(scope="module")
def router(
    tmp_path_factory: pytest.TempPathFactory, free_tcp_port: Callable[[], int]
) -> Iterator[SecureRouter]:
    """The generated configuration, with one more subject that may do everything."""
    folder = tmp_path_factory.mktemp("certificates")
    make(folder, days=1, server_names=["localhost"])
    endpoint = f"tls/localhost:{free_tcp_port()}"
    config = secure(endpoint, PurePosixPath(folder / "router"))
    access = config["access_control"]
    messages = {message for rule in access["rules"] for message in rule["messages"]} | {"delete"}
    access["rules"].append(
        {
            "id": OBSERVER,
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "messages": sorted(messages),
            "key_exprs": ["**", "@/**"],
        }
    )
    access["subjects"].append({"id": OBSERVER, "cert_common_names": [OBSERVER]})
    access["policies"].append({"subjects": [OBSERVER], "rules": [OBSERVER]})
    file = folder / "router.json5"
    file.write_text(render(config))
    process = subprocess.Popen(
        [sys.executable, "-m", "bpn_shared.bus.router", "--config", str(file)]
    )
    secured = SecureRouter(endpoint, folder)
    secured.issue(OBSERVER, x509.issue(secured.authority, OBSERVER, Validity.of_days(1)))
    try:
        secured.open_as(OBSERVER).close()  # it waits until the router is there
        yield secured
    finally:
        process.terminate()
        process.wait(10)


@pytest.fixture
def open_as(router: SecureRouter) -> Iterator[Callable[[str], Bus]]:
    """Opens sessions of roles, which are closed with the test."""
    opened: list[Bus] = []

    def open_one(name: str) -> Bus:
        opened.append(router.open_as(name))
        return opened[-1]

    yield open_one
    for bus in opened:
        bus.close()
