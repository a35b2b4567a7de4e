"""A router with certificates and access control in a process of its own, and sessions of every role."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from secure_router import SecureRouter, secure_router

from bpn_certificates import authority as x509
from bpn_certificates.authority import Validity
from bpn_shared.bus.session import Bus

OBSERVER = "observer"
"""Sees and may do everything, so that it can tell what got through; only this router knows it."""


def let_observe(config: Any) -> None:
    """One more subject, which may do everything."""
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


@pytest.fixture(scope="module")
def router(
    tmp_path_factory: pytest.TempPathFactory, free_tcp_port: Callable[[], int]
) -> Iterator[SecureRouter]:
    """The generated configuration, with the observer."""
    endpoint = f"tls/localhost:{free_tcp_port()}"
    with secure_router(tmp_path_factory.mktemp("certificates"), endpoint, let_observe) as secured:
        secured.issue(OBSERVER, x509.issue(secured.authority, OBSERVER, Validity.of_days(1)))
        yield secured


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
