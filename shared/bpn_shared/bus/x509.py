"""When a certificate is good, and whose it is: the few fields of X.509 that messages to people need.

Python's `ssl` tells them of nobody but the peer that it has accepted, and who was not accepted is what people ask
about. Who is trusted is decided by TLS alone, not here.
"""

import ssl
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

_SHORT_TIME, _OCTETS, _VERSION, _EXTENSIONS = 0x17, 0x04, 0xA0, 0xA3  # tags
_DNS_NAME, _ADDRESS = 0x82, 0x87
_COMMON_NAME, _SERVER_NAMES = (
    bytes([0x55, 0x04, 0x03]),
    bytes([0x55, 0x1D, 0x11]),
)  # object identifiers
_BEGIN, _END = "-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----"


WARN_BEFORE = timedelta(days=30)
WARN_PART = 4
"""Of certificates that live shorter, only the last quarter of their life is near the end."""


class Life(NamedTuple):
    """From when to when a certificate is good."""

    start: datetime
    end: datetime

    def left(self, now: datetime) -> timedelta:
        """Until its end; below 0: it has expired."""
        return self.end - now

    def is_near_end(self, now: datetime) -> bool:
        """Whether people should hear of it; true as well of one that has expired."""
        return self.left(now) < min(WARN_BEFORE, (self.end - self.start) / WARN_PART)


class CertificateFacts(NamedTuple):
    """What a certificate says of itself."""

    common_name: str
    start: datetime
    end: datetime
    server_names: frozenset[str]
    """DNS names and IP addresses by which it may be reached."""

    @property
    def life(self) -> Life:
        """From when to when it is good."""
        return Life(self.start, self.end)


def facts(der: bytes) -> CertificateFacts:
    """Reads a certificate in DER.

    Raises:
        ValueError: it is none.
    """
    try:
        _, certificate, _ = _element(der)
        _, body, _ = _element(certificate)  # to be signed: version, serial, algorithm, issuer, ...
        tag, _, rest = _element(body)
        for _ in range(3 if tag == _VERSION else 2):
            _, _, rest = _element(rest)
        _, validity, rest = _element(rest)
        _, subject, rest = _element(rest)
        start, end = _times(validity)
        return CertificateFacts(_common_name(subject), start, end, frozenset(_server_names(rest)))
    except (IndexError, StopIteration, RuntimeError, UnicodeDecodeError) as error:
        raise ValueError("not a certificate") from error


def facts_of(path: Path) -> CertificateFacts:
    """Reads the first certificate of a PEM file.

    Raises:
        OSError: it cannot be read.
        ValueError: there is none in it.
    """
    text = path.read_text(encoding="ascii", errors="replace")
    begin = text.find(_BEGIN)
    end = text.find(_END, begin)
    if begin < 0 or end < 0:
        raise ValueError(f"{path} holds no certificate")
    try:
        return facts(ssl.PEM_cert_to_DER_cert(text[begin : end + len(_END)]))
    except ValueError as error:
        raise ValueError(f"{path} holds no certificate that can be read") from error


def _element(der: bytes) -> tuple[int, bytes, bytes]:
    """Tag and contents of the first element, and what follows it."""
    tag, length, begin = der[0], der[1], 2
    if length >= 0x80:  # so many bytes say how long it is
        begin += length & 0x7F
        length = int.from_bytes(der[2:begin])
    if len(der) < begin + length:
        raise IndexError("cut off")
    return tag, der[begin : begin + length], der[begin + length :]


def _times(validity: bytes) -> tuple[datetime, datetime]:
    start_tag, start, rest = _element(validity)
    end_tag, end, _ = _element(rest)
    return _time(start_tag, start), _time(end_tag, end)


def _time(tag: int, text: bytes) -> datetime:
    form = "%y%m%d%H%M%SZ" if tag == _SHORT_TIME else "%Y%m%d%H%M%SZ"
    return datetime.strptime(text.decode(), form).replace(tzinfo=UTC)


def _common_name(subject: bytes) -> str:
    while subject:
        _, names, subject = _element(subject)  # a set of (kind, value)
        _, name, _ = _element(names)
        _, kind, rest = _element(name)
        _, value, _ = _element(rest)
        if kind == _COMMON_NAME:
            return value.decode()
    return ""


def _server_names(after_subject: bytes) -> Iterator[str]:
    for tag, field in _elements(after_subject):
        if tag != _EXTENSIONS:
            continue
        _, extensions, _ = _element(field)
        for _, extension in _elements(extensions):
            (_, kind), *others = _elements(extension)
            if kind == _SERVER_NAMES:
                _, names, _ = _element(next(value for what, value in others if what == _OCTETS))
                for what, name in _elements(names):
                    if what == _DNS_NAME:
                        yield name.decode()
                    elif what == _ADDRESS:
                        yield str(ip_address(name))


def _elements(der: bytes) -> Iterator[tuple[int, bytes]]:
    while der:
        tag, contents, der = _element(der)
        yield tag, contents
