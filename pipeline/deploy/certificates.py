"""Certificates for TLS between machines: an authority of one's own and one certificate a machine.

    authority (ca.pem, ca-key.pem) ──signs──► shore.pem   t1.tower.pem   viewer.pem   …

The name in a machine's certificate is what access control knows it by. Private keys are readable
by their owner alone, are never overwritten, and belong on no other machine than their own; the
authority's key belongs on none of them.
"""

import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sensors.errors import InputError
from sensors.extras import import_extra

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

AUTHORITY = "ca"
VALID_DAYS = 825  # of a machine's certificate
AUTHORITY_DAYS = 3650
CLOCKS_DIFFER = timedelta(minutes=10)  # a certificate holds from so long before it was made


class CertificateError(InputError):
    """A certificate that cannot be made or read."""


@dataclass(frozen=True, slots=True)
class Identity:
    """A certificate and its private key, as PEM files."""

    name: str

    def certificate(self, folder: Path) -> Path:
        """Path of the certificate."""
        return folder / f"{self.name}.pem"

    def key(self, folder: Path) -> Path:
        """Path of its private key."""
        return folder / f"{self.name}-key.pem"

    def exists(self, folder: Path) -> bool:
        """Whether it has been made."""
        return self.certificate(folder).exists() and self.key(folder).exists()


def make_certificates(folder: Path, names: Sequence[str], *, host: str) -> list[str]:
    """Make what is missing: the authority, and a certificate of each name.

    Parameters
    ----------
    folder : Path
        Is made where there is none; what exists in it is kept.
    names : sequence of str
        Of the machines; the first one is listened on, at `host`.
    host : str
        Name or address that others connect to; "localhost" and the loopback address hold too.

    Returns
    -------
    list of str
        The names that are new.

    Raises
    ------
    CertificateError
        If cryptography is missing, or a file cannot be read or written.
    """
    import_extra("cryptography", "security", "certificates", CertificateError)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        authority, authority_key, new = _authority(folder)
        made = [AUTHORITY] if new else []
        for number, name in enumerate(names):
            if Identity(name).exists(folder):
                continue
            key = _new_key()
            hosts = [host, "localhost", "127.0.0.1"] if number == 0 else []
            certificate = _signed(name, key, authority, authority_key, hosts)
            _write(folder, name, certificate, key)
            made.append(name)
    except OSError as error:
        raise CertificateError(
            f"cannot write certificates to {folder}: {error.strerror}; a folder that can be "
            "written is needed"
        ) from error
    return made


def _authority(folder: Path) -> tuple["x509.Certificate", "EllipticCurvePrivateKey", bool]:
    identity = Identity(AUTHORITY)
    if identity.exists(folder):
        return *_read(folder), False
    key = _new_key()
    certificate = _signed("pilewatch authority", key, None, key, [])
    _write(folder, AUTHORITY, certificate, key)
    return certificate, key, True


def _read(folder: Path) -> tuple["x509.Certificate", "EllipticCurvePrivateKey"]:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    identity = Identity(AUTHORITY)
    try:
        certificate = x509.load_pem_x509_certificate(identity.certificate(folder).read_bytes())
        key = load_pem_private_key(identity.key(folder).read_bytes(), password=None)
    except ValueError as error:
        raise CertificateError(
            f"{identity.certificate(folder)} and {identity.key(folder)} are no authority; move "
            "them away for a new one"
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise CertificateError(f"{identity.key(folder)} is not of the kind made here (P-256)")
    return certificate, key


def _new_key() -> "EllipticCurvePrivateKey":
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _signed(
    name: str,
    key: "EllipticCurvePrivateKey",
    authority: "x509.Certificate | None",
    authority_key: "EllipticCurvePrivateKey",
    hosts: Sequence[str],
) -> "x509.Certificate":
    """authority   None: this one is the authority itself"""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    is_authority = authority is None
    days = AUTHORITY_DAYS if is_authority else VALID_DAYS
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if authority is None else authority.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCKS_DIFFER)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(
            x509.BasicConstraints(ca=is_authority, path_length=0 if is_authority else None),
            critical=True,
        )
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(_key_usage(is_authority), critical=True)
    )
    if not is_authority:
        # Python 3.13 refuses a certificate that does not name its signer's key (RFC 5280)
        signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority_key.public_key())
        builder = builder.add_extension(signer, critical=False)
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    if hosts:
        names = x509.SubjectAlternativeName([_host(each) for each in dict.fromkeys(hosts)])
        builder = builder.add_extension(names, critical=False)
    return builder.sign(authority_key, hashes.SHA256())


def _key_usage(is_authority: bool) -> "x509.KeyUsage":
    """An authority signs certificates, a machine its handshakes (RFC 5280, 4.2.1.3)."""
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not is_authority,
        key_cert_sign=is_authority,
        crl_sign=is_authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _host(text: str) -> Any:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(text))
    except ValueError:
        return x509.DNSName(text)


def _write(
    folder: Path, name: str, certificate: "x509.Certificate", key: "EllipticCurvePrivateKey"
) -> None:
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
    )

    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    descriptor = os.open(Identity(name).key(folder), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "wb") as file:
        file.write(secret)
    Identity(name).certificate(folder).write_bytes(certificate.public_bytes(Encoding.PEM))
