"""X.509 as the services need it: an authority that signs certificates of servers and of clients."""

import datetime
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

BACKDATED = datetime.timedelta(minutes=5)
"""So that a machine whose clock is a little behind accepts a new certificate."""


@dataclass(frozen=True)
class Identity:
    """A certificate and its private key (elliptic curve P-256)."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    def certificate_pem(self) -> bytes:
        return self.certificate.public_bytes(serialization.Encoding.PEM)

    def key_pem(self) -> bytes:
        return self.key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )

    @classmethod
    def from_pem(cls, certificate: bytes, key: bytes) -> Self:
        """Reads what `certificate_pem` and `key_pem` wrote.

        Raises:
            ValueError: not PEM, another kind of key, or they do not belong together.
        """
        parsed = x509.load_pem_x509_certificate(certificate)
        private = serialization.load_pem_private_key(key, password=None)
        if not isinstance(private, ec.EllipticCurvePrivateKey):
            raise ValueError(f"a {type(private).__name__}, not an elliptic curve key")
        if parsed.public_key() != private.public_key():
            raise ValueError("the key is not the certificate's")
        return cls(parsed, private)


@dataclass(frozen=True)
class Validity:
    """From when to when a certificate is good."""

    start: datetime.datetime
    end: datetime.datetime

    @classmethod
    def of_days(cls, days: float) -> Self:
        """From now on."""
        now = datetime.datetime.now(datetime.UTC)
        return cls(now - BACKDATED, now + datetime.timedelta(days=days))


def new_authority(name: str, validity: Validity) -> Identity:
    """A new root: it may sign certificates of services, and no further authorities."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _common_name(name)
    builder = (
        _builder(subject, subject, key.public_key(), key, validity)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return Identity(builder.sign(key, hashes.SHA256()), key)


def issue(
    authority: Identity, role: str, validity: Validity, *, server_names: Sequence[str] = ()
) -> Identity:
    """A certificate that names a role, and its new key; as `certify` makes it."""
    key = ec.generate_private_key(ec.SECP256R1())
    certificate = certify(authority, role, key.public_key(), validity, server_names=server_names)
    return Identity(certificate, key)


def certify(
    authority: Identity,
    common_name: str,
    public_key: ec.EllipticCurvePublicKey,
    validity: Validity,
    *,
    server_names: Sequence[str] = (),
) -> x509.Certificate:
    """A certificate for who has the key; with `server_names` it is a server's as well as a client's.

    Args:
        server_names: DNS names and IP addresses that clients reach the server by.
    """
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if server_names:  # a router is another router's client
        purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
    subject, issuer = _common_name(common_name), authority.certificate.subject
    builder = (
        _builder(subject, issuer, public_key, authority.key, validity)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    )
    if server_names:
        names = x509.SubjectAlternativeName([_server_name(name) for name in server_names])
        builder = builder.add_extension(names, critical=False)
    return builder.sign(authority.key, hashes.SHA256())


def new_key() -> ec.EllipticCurvePrivateKey:
    """For a certificate that another machine signs."""
    return ec.generate_private_key(ec.SECP256R1())


def signing_request(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Asks for a certificate (PEM), whose name is for the authority to say; the key itself stays where it is."""
    builder = x509.CertificateSigningRequestBuilder().subject_name(x509.Name([]))
    return builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def requested_key(request: bytes) -> ec.EllipticCurvePublicKey:
    """The key that a request is for, which its sender has proved to own.

    Raises:
        ValueError: it is no request, its signature is wrong, or the key is not of P-256.
    """
    asked = x509.load_pem_x509_csr(request)
    key = asked.public_key()
    if not asked.is_signature_valid:
        raise ValueError("the request is not signed by its own key")
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise ValueError("the key must be of the elliptic curve P-256")
    return key


def key_digest(key: ec.EllipticCurvePublicKey) -> str:
    """SHA-256 of a public key."""
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    return hashlib.sha256(key.public_bytes(serialization.Encoding.DER, form)).hexdigest()


def is_issued_by(certificate: x509.Certificate, authority: x509.Certificate) -> bool:
    """Whether the authority's key signed the certificate."""
    try:
        certificate.verify_directly_issued_by(authority)
    except Exception:  # wrong name, wrong signature, another kind of key: each is a no
        return False
    return True


def common_name(certificate: x509.Certificate) -> str:
    """Whom a certificate names."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def server_names(certificate: x509.Certificate) -> set[str]:
    """The DNS names and IP addresses of a server's certificate; none for a client's."""
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return set()
    return {str(name.value) for name in found}


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    issuer_key: ec.EllipticCurvePrivateKey,
    validity: Validity,
) -> x509.CertificateBuilder:
    issuer_id = x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key())
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(validity.start)
        .not_valid_after(validity.end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
        .add_extension(issuer_id, critical=False)
    )


def _common_name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _server_name(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
