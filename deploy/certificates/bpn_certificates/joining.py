"""The machine's end of joining: its key, its certificate, and what it remembers of both.

The first contact is with whoever has the authority that the token names: its certificate is fetched from anyone
who answers and counts only if it has the token's fingerprint; after that TLS itself is checked against it.
"""

import base64
import http.client
import json
import socket
import ssl
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

from cryptography import x509 as certificates
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from bpn_certificates.authority import new_key, signing_request
from bpn_certificates.enrolment import AUTHORITY_PATH, MACHINES_PATH, RENEWALS_PATH
from bpn_certificates.token import Token, digest, fingerprint
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, KEY, CertificateFiles
from bpn_shared.bus.identity import Identity
from bpn_shared.errors import InputError, one_line
from bpn_shared.runs.files import write_atomically

_TIMEOUT_S = 10.0
_MAX_ANSWER_BYTES = 64 * 1024
_ELSEWHERE = "is no place to join: it answers otherwise"
_FILE, _FOLDER, _NEW_KEY = "machine.json", "certificates", "new-key.pem"


class UnreachableError(Exception):
    """Nobody answers there; the message says where and why."""


class Machine(NamedTuple):
    """What a machine that has joined knows.

    Attributes:
        folder: where its certificates are.
        host: of the machine that it joined.
        router_port, enrolment_port: there.
    """

    folder: Path
    identity: Identity
    host: str
    router_port: int
    enrolment_port: int

    @property
    def endpoint(self) -> str:
        """The router's, in Zenoh's form."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"tls/{host}:{self.router_port}"

    @property
    def files(self) -> CertificateFiles:
        return CertificateFiles.in_folder(self.folder)

    @classmethod
    def load(cls, state: Path) -> Self:
        """What `join` has left in a folder.

        Raises:
            InputError: nothing that can be used.
        """
        if not (state / _FILE).exists():
            raise InputError(
                "this machine has not joined yet: give the token that `bpn up` or `bpn invite` printed there"
            )
        try:
            told = _told(state)
            identity = Identity.parse(told["common_name"])
            ports = int(told["router_port"]), int(told["enrolment_port"])
            if identity is None:
                raise ValueError(told["common_name"])
            return cls(state / _FOLDER, identity, str(told["host"]), *ports)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{state / _FILE} is damaged: join again with a new token") from error

    def renew(self) -> None:
        """Fetches a new certificate for its key, with the one that it has.

        Raises:
            InputError: it has been removed; the message says so.
            UnreachableError, OSError: later perhaps.
        """
        key = _private(self.files.key)
        body = {"request": signing_request(key).decode()}
        context = _trusting(self.files.authority.read_text())
        context.load_cert_chain(self.files.certificate, self.files.key)
        answer = _ask(
            self.host, self.enrolment_port, RENEWALS_PATH, body, context, told=("certificate",)
        )
        write_atomically(self.files.certificate, answer["certificate"].encode(), mode=0o444)


def join(token: Token, name: str, state: Path) -> Machine:
    """Has this machine admitted, and keeps what it needs in a folder.

    Args:
        token: one with which this machine has joined already does nothing more.
        name: what it calls itself, unless the invitation was for one of a name.

    Raises:
        InputError: it is not admitted, or who answers has another authority; the message says why.
        UnreachableError: nobody answers at any of the token's hosts.
        OSError: the folder cannot be written.
    """
    state.mkdir(mode=0o700, parents=True, exist_ok=True)
    with suppress(InputError, ValueError, TypeError, OSError):
        if _told(state).get("token_sha256") == digest(token.secret):
            return Machine.load(state)
    key = _key(state)
    reasons: list[str] = []
    is_other = False
    for host in token.hosts:
        try:
            authority = _authority(token, host)
        except (InputError, UnreachableError) as error:  # an address may be another machine's too
            is_other |= isinstance(error, InputError)
            reasons.append(str(error))
            continue
        body = {
            "secret": base64.b64encode(token.secret).decode(),
            "name": name,
            "request": signing_request(key).decode(),
        }
        told = ("common_name", "certificate")
        try:
            answer = _ask(
                host, token.port, MACHINES_PATH, body, _trusting(authority.decode()), told=told
            )
        except UnreachableError as error:
            reasons.append(str(error))
            continue
        identity = Identity.parse(answer["common_name"])
        if identity is None:
            raise InputError(
                f"{host} calls this machine {answer['common_name']!r}, which is no name"
            )
        _keep(state / _FOLDER, key, answer["certificate"].encode(), authority)
        known = {
            "common_name": identity.common_name,
            "host": host,
            "router_port": int(answer["router_port"]),
            "enrolment_port": token.port,
            "token_sha256": digest(token.secret),
        }
        write_atomically(state / _FILE, json.dumps(known, indent=1).encode(), mode=0o600)
        (state / _NEW_KEY).unlink()
        return Machine.load(state)
    raise (InputError if is_other else UnreachableError)("; ".join(reasons))


def _told(state: Path) -> dict[str, Any]:
    """What is written of a machine that has joined; nothing of one that has not."""
    with suppress(FileNotFoundError):
        return dict(json.loads((state / _FILE).read_bytes()))
    return {}


def _key(state: Path) -> ec.EllipticCurvePrivateKey:
    """The one with which this machine has asked before, if no answer came: asked again it gets the same one."""
    path = state / _NEW_KEY
    with suppress(FileNotFoundError, ValueError):
        return _private(path)
    key = new_key()
    write_atomically(path, _pem(key), mode=0o400)
    return key


def _private(path: Path) -> ec.EllipticCurvePrivateKey:
    """Raises:
    FileNotFoundError, ValueError: there is none that can be used.
    """
    key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ValueError(f"{path} holds no elliptic curve key")
    return key


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _keep(
    folder: Path, key: ec.EllipticCurvePrivateKey, certificate: bytes, authority: bytes
) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_atomically(folder / AUTHORITY, authority, mode=0o444)
    write_atomically(folder / KEY, _pem(key), mode=0o400)
    write_atomically(folder / CERTIFICATE, certificate, mode=0o444)


def _authority(token: Token, host: str) -> bytes:
    """The authority's certificate, if it is the token's."""
    anyone = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    anyone.check_hostname, anyone.verify_mode = False, ssl.CERT_NONE
    answer = _ask(host, token.port, AUTHORITY_PATH, None, anyone, told=("authority",))
    pem: bytes = answer["authority"].encode()
    try:
        found = fingerprint(certificates.load_pem_x509_certificate(pem))
    except ValueError as error:
        raise InputError(f"{host} port {token.port} {_ELSEWHERE}") from error
    if found != token.authority:
        raise InputError(
            f"who answers at {host} port {token.port} has another authority than the token's: nothing was sent"
        )
    return pem


def _trusting(authority: str) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(cadata=authority)
    return context


def _ask(
    host: str,
    port: int,
    path: str,
    body: dict[str, str] | None,
    context: ssl.SSLContext,
    *,
    told: Sequence[str],
) -> dict[str, Any]:
    """The answer, which tells these texts.

    Raises:
        InputError: a refusal, with its reason.
        UnreachableError: there is none.
    """
    connection = http.client.HTTPSConnection(host, port, timeout=_TIMEOUT_S, context=context)
    try:
        data = None if body is None else json.dumps(body)
        connection.request("GET" if data is None else "POST", path, data)
        answer = connection.getresponse()
        content = json.loads(answer.read(_MAX_ANSWER_BYTES))
        refusal = content["error"] if answer.status >= http.client.BAD_REQUEST else None
        if refusal is None and not all(isinstance(content[name], str) for name in told):
            raise TypeError(path)
    except ssl.SSLCertVerificationError as error:
        raise InputError(f"{host} port {port} cannot be trusted: {error.verify_message}") from error
    except (socket.gaierror, OSError, http.client.HTTPException) as error:
        raise UnreachableError(f"{host} port {port}: {one_line(error)}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{host} port {port} {_ELSEWHERE}") from error
    finally:
        connection.close()
    if refusal is not None:
        raise InputError(f"{host} refuses this machine: {refusal}")
    return dict(content)
