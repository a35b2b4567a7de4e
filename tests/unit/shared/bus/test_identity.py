"""Names of sites and machines: in workers' ids, in certificates, in keys."""

import json
from pathlib import Path

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from bpn_certificates import authority as x509
from bpn_certificates.folders import make, store
from bpn_shared.bus import keys
from bpn_shared.bus.access import CHANNELS, ROUTER, Grant
from bpn_shared.bus.admitted import ADMITTED, AdmittedError, AdmittedWatch, read_admitted
from bpn_shared.bus.certificates import FOLDER_VARIABLE, CertificateError, own_site
from bpn_shared.bus.identity import MACHINE_ROLES, Identity
from bpn_shared.errors import InputError
from bpn_shared.messages.lease import LeaseRequest
from bpn_shared.runtime.service import new_worker_id, protocol_of
from bpn_shared.site import MAIN_SITE, check_name, site_of
from bpn_shared.version import PROTOCOL

names = st.from_regex(r"[a-z0-9]([a-z0-9-]{0,22}[a-z0-9])?", fullmatch=True)
sites = names.filter(lambda name: name != MAIN_SITE)
identities = st.builds(Identity, st.sampled_from((*MACHINE_ROLES, ROUTER)), sites, names)


@given(names, st.sampled_from(("learner", "edge", "robot_sim")))
def test_a_workers_id_tells_site_and_protocol_and_is_one_on_the_wire(site: str, role: str) -> None:
    worker = new_worker_id(role, site)
    assert (site_of(worker), protocol_of(worker)) == (site, PROTOCOL)
    asked = LeaseRequest(role=role, worker=worker)  # type: ignore[arg-type]
    assert LeaseRequest.decode(asked.encode()).worker == worker


@given(st.text(max_size=30))
def test_what_is_no_name_is_refused(text: str) -> None:
    ok = 1 <= len(text) <= 24 and all(c in "abcdefghijklmnopqrstuvwxyz0123456789-" for c in text)
    if ok and not text.startswith("-") and not text.endswith("-"):
        assert check_name(text, "--name") == text
    else:
        with pytest.raises(InputError, match="--name = "):
            check_name(text, "--name")


@given(identities)
def test_a_common_name_is_read_as_it_was_written_and_fits(identity: Identity) -> None:
    assert Identity.parse(identity.common_name) == identity
    assert len(identity.common_name) <= 64  # X.509 allows no more


@pytest.mark.parametrize(
    "other", ["edge", "router", "learner@a.b", "edge@main.b", "edge@a", "edge@A.b", "edge@a.b.c", "@a.b", ""]
)  # fmt: skip
def test_other_common_names_name_no_machine(other: str) -> None:
    assert Identity.parse(other) is None


@given(identities, identities)
def test_no_right_to_give_is_common_to_two_sites(one: Identity, other: Identity) -> None:
    if one.site == other.site:
        return
    giving = {("ingress", "put"), ("ingress", "liveliness_token"), ("ingress", "declare_queryable")}
    shared = {"log", "probe"}  # which have no site in their keys
    for mine in one.grants():
        for theirs in other.grants():
            if {mine[1:3], theirs[1:3]} <= giving and not shared & set(mine.key.split("/")):
                assert not zenoh.KeyExpr(mine.key).intersects(zenoh.KeyExpr(theirs.key)), mine.key


@given(identities)
def test_a_machine_may_nothing_that_its_roles_may_not(identity: Identity) -> None:
    allowed = {(grant[:3], grant.key) for channel in CHANNELS for grant in channel.grants()}
    for grant in identity.grants():
        if grant.key != "bpn/**":
            wider = [key for name, key in allowed if name == grant[:3]]
            assert any(zenoh.KeyExpr(key).includes(zenoh.KeyExpr(grant.key)) for key in wider)


def test_a_robot_is_no_edge() -> None:
    robot = Identity.of("robot_sim", "lab-b", "pi-7").grants()
    assert {grant.role for grant in robot} == {"robot_sim"}
    frame = keys.frame("*", "*", "lab-b")
    assert Grant("robot_sim", "ingress", "put", frame) in robot


@pytest.mark.parametrize(
    "content", ["", "{}", "[1]", '["edge"]', '["edge@a.b", null]', "[" * 1000, "x" * 300_000]
)  # fmt: skip
def test_a_list_that_is_none_is_refused_and_changes_nothing(content: str, tmp_path: Path) -> None:
    machine = Identity.of("router", "a", "b")
    (tmp_path / ADMITTED).write_text(json.dumps([machine.common_name]))
    watch = AdmittedWatch(tmp_path)
    assert watch.machines == (machine,)
    (tmp_path / ADMITTED).write_text(content)
    with pytest.raises(AdmittedError):
        read_admitted(tmp_path)
    assert not watch.changed()
    assert watch.machines == (machine,)
    (tmp_path / ADMITTED).unlink()
    assert watch.changed()
    assert watch.machines == ()


def test_a_worker_is_where_its_certificate_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    assert own_site(None) == MAIN_SITE
    assert own_site("lab-c") == "lab-c"
    with pytest.raises(InputError, match="--site"):
        own_site("Lab C")
    make(tmp_path, days=1, server_names=["localhost"])
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "edge"))
    assert own_site("lab-c") == "lab-c"  # a role's certificate is good anywhere
    authority = x509.Identity.from_pem(
        (tmp_path / "authority" / "certificate.pem").read_bytes(),
        (tmp_path / "authority" / "key.pem").read_bytes(),
    )
    name = Identity.of("edge", "lab-b", "pi-7").common_name
    store(tmp_path / "pi", x509.issue(authority, name, x509.Validity.of_days(1)), authority)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "pi"))
    assert own_site(None) == own_site("lab-b") == "lab-b"
    with pytest.raises(CertificateError, match="of site lab-b"):
        own_site("lab-c")
