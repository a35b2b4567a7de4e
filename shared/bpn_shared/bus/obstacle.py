"""Why a router cannot be reached, in words that name what to mend.

Zenoh says of every failed connection that it failed. Here the same is tried once more with Python's own sockets
and TLS, with the same certificates, and the error that comes tells the reason.
"""

import re
import socket
import ssl
from contextlib import suppress
from datetime import UTC, datetime

from bpn_shared.bus.certificates import CertificateFiles, own_certificates
from bpn_shared.bus.endpoint import network
from bpn_shared.bus.x509 import CertificateFacts, facts, facts_of
from bpn_shared.errors import one_line

TIMEOUT_S = 2.0
_REMEDY = "start one with `bpn-router` or name it with --connect"
_ALERT_S = 0.5
"""A router that does not accept a client's certificate says so after its own part of the handshake."""

_RUST_PLACE = re.compile(r",? at (?:/\S+|\S+\.rs)\S*\.rs:[0-9]+\.?")

# OpenSSL's numbers of reasons why a certificate is not accepted
_NOT_YET_VALID, _EXPIRED, _WRONG_NAME, _WRONG_ADDRESS = 9, 10, 62, 64
_ALERTS = {
    "CERTIFICATE_EXPIRED": "it says that our certificate has expired",
    "UNKNOWN_CA": "it does not know the authority of our certificate",
    "BAD_CERTIFICATE": "it does not accept our certificate",
    "CERTIFICATE_UNKNOWN": "it does not accept our certificate",
    "DECRYPT_ERROR": "our certificate is not signed by the authority that it trusts",
    "CERTIFICATE_REQUIRED": "it demands a certificate",
    "ACCESS_DENIED": "it denies access",
}


def plain(error: Exception) -> str:
    """What Zenoh says, without places in its source code."""
    return _RUST_PLACE.sub("", str(error)).strip()


def obstacle(
    endpoint: str, files: CertificateFiles | None = None, *, any_name: bool = False
) -> str:
    """Tries to connect, and says why that fails; empty: it does not, or nobody can say why.

    Args:
        endpoint: a router's, in Zenoh's form.
        files: our certificates; None: those in the folder that the environment names.
        any_name: whether the router's certificate may be for other names than the endpoint's.
    """
    parts = network(endpoint)
    if parts is None or parts.protocol not in ("tcp", "tls"):
        return _socket_file_obstacle(endpoint)
    protocol, host, port = parts
    try:
        if protocol == "tls":
            return _tls_obstacle(host, port, files or own_certificates(), any_name=any_name)
        socket.create_connection((host, port), TIMEOUT_S).close()
        return ""
    except (OSError, OverflowError, UnicodeError) as error:
        return _network_obstacle(error, host, port)


def router_certificate(endpoint: str) -> CertificateFacts | None:
    """The certificate that a router presents, trusted or not; None: nobody presents one there.

    Args:
        endpoint: the router's, in Zenoh's form.
    """
    parts = network(endpoint)
    if parts is None or parts.protocol != "tls":
        return None
    return _peer((parts.host, parts.port))


def _network_obstacle(error: Exception, host: str, port: int) -> str:
    if isinstance(error, ConnectionRefusedError):
        return f"nobody listens at {host} port {port}; {_REMEDY}"
    if isinstance(error, socket.gaierror):
        return f"the name {host} cannot be resolved ({error.strerror})"
    if isinstance(error, TimeoutError):
        return f"{host} port {port} does not answer"
    return f"{host} port {port}: {one_line(error)}"


def _tls_obstacle(host: str, port: int, files: CertificateFiles | None, *, any_name: bool) -> str:
    if files is None:
        return ""
    if reason := own_obstacle(files):
        return reason
    context = _context(files)
    context.check_hostname = not any_name
    with socket.create_connection((host, port), TIMEOUT_S) as connection:
        return _handshake_obstacle(context, connection, host)


def _socket_file_obstacle(endpoint: str) -> str:
    protocol, _, path = endpoint.partition("/")
    if protocol != "unixsock-stream":
        return ""
    with socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(TIMEOUT_S)
        try:
            probe.connect(path)
        except FileNotFoundError:
            return f"there is no {path}; {_REMEDY}"
        except ConnectionRefusedError:
            return f"nobody listens at {path}; {_REMEDY}"
        except OSError as error:
            return f"{path}: {error.strerror or error}"
    return ""


def _context(files: CertificateFiles) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(files.authority)
    context.load_cert_chain(files.certificate, files.key)
    return context


def own_obstacle(files: CertificateFiles) -> str:
    """What is wrong with our own certificate and key, as far as it can be seen alone; empty: nothing."""
    try:
        ours, authority = facts_of(files.certificate), facts_of(files.authority)
        _context(files)
    except ssl.SSLError as error:
        if "KEY_VALUES_MISMATCH" in str(error):
            return f"{files.key} is not the key of {files.certificate}"
        return f"{files.certificate} cannot be used: {error.reason or error}"
    except OSError as error:
        return f"{error.filename or files.key} cannot be read: {error.strerror}"
    except ValueError as error:
        return str(error)
    return _out_of_date(f"our certificate {files.certificate}", ours) or _out_of_date(
        f"the authority's certificate {files.authority}", authority
    )


def _out_of_date(what: str, certificate: CertificateFacts) -> str:
    now = datetime.now(UTC)
    name = f"{what} ({certificate.common_name})"
    if now > certificate.end:
        return f"{name} expired {certificate.end:%Y-%m-%d %H:%M:%S} UTC"
    if now < certificate.start:
        return f"{name} is not good before {certificate.start:%Y-%m-%d %H:%M:%S} UTC: see the clock"
    return ""


def _handshake_obstacle(context: ssl.SSLContext, connection: socket.socket, host: str) -> str:
    address = connection.getpeername()
    try:
        with context.wrap_socket(connection, server_hostname=host) as secured:
            secured.settimeout(_ALERT_S)
            with suppress(TimeoutError):  # silence: we are let in
                secured.recv(1)
        return ""
    except ssl.SSLCertVerificationError as error:
        return _verification_obstacle(error, address, host)
    except ssl.SSLError as error:
        said = next((text for name, text in _ALERTS.items() if name in (error.reason or "")), None)
        if said is None:
            return f"the router at {host} speaks no TLS that is accepted here ({error.reason or error})"
        return f"the router refuses us: {said}"
    except TimeoutError:
        return f"who listens at {host} port {address[1]} does not answer to TLS"
    except ConnectionResetError:
        return "the router ended the connection during the TLS handshake"


def _verification_obstacle(
    error: ssl.SSLCertVerificationError, address: tuple[object, ...], host: str
) -> str:
    if error.verify_code in (_WRONG_NAME, _WRONG_ADDRESS):
        return f"the router's certificate is not for the name {host}"
    if error.verify_code in (_EXPIRED, _NOT_YET_VALID):
        theirs = _peer(address)
        reason = theirs and _out_of_date("the router's certificate", theirs)
        return reason or f"the router's certificate: {error.verify_message}"
    return "the router's certificate is of another authority than the one that is trusted here"


def _peer(address: tuple[object, ...]) -> CertificateFacts | None:
    """The certificate of whoever answers there, trusted or not."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with (
        suppress(OSError, OverflowError, ValueError),  # UnicodeError is a ValueError
        socket.create_connection((str(address[0]), address[1]), TIMEOUT_S) as connection,  # type: ignore[arg-type]
        context.wrap_socket(connection) as secured,
    ):
        return facts(secured.getpeercert(binary_form=True) or b"")
    return None
