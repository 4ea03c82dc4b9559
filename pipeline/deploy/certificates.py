"""Certificates for TLS between machines: an authority of one's own and one certificate a machine.

    authority (ca.pem, ca-key.pem) ──signs──► shore.pem   t1.tower.pem   viewer.pem   …

The name in a machine's certificate is what access control knows it by. Private keys are readable
by their owner alone, are never overwritten, and belong on no other machine than their own; the
authority's key belongs on none of them.
"""

import ipaddress
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
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
ENDS_SOON = timedelta(days=30)  # from then on it is reported
KEY_SUFFIX = "-key"
LONGEST_COMMON_NAME = 64  # in a certificate [bytes of UTF-8] (RFC 5280, ub-common-name)
LONGEST_HOST = 253  # (RFC 1035, 2.3.4)

_HOST = re.compile(r"[a-z0-9_-]{1,63}(\.[a-z0-9_-]{1,63})*", re.IGNORECASE)


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
        return folder / f"{self.name}{KEY_SUFFIX}.pem"

    def exists(self, folder: Path) -> bool:
        """Whether it has been made; its key may have gone to its machine, or off line.

        Raises CertificateError where the key is left alone: no other may take its place.
        """
        certificate, key = self.certificate(folder), self.key(folder)
        if key.exists() and not certificate.exists():
            raise CertificateError(
                f"{certificate} is missing beside {key}: put it back, or move {key.name} away for "
                "a new pair"
            )
        return certificate.exists()


def make_certificates(
    folder: Path, names: Sequence[str], *, host: str, now: datetime | None = None
) -> list[str]:
    """Make what is missing: the authority, and a certificate of each name.

    Parameters
    ----------
    folder : Path
        Is made where there is none; what exists in it is kept.
    names : sequence of str
        Of the machines; the first one is listened on, at `host`.
    host : str
        Name or address that others connect to; "localhost" and the loopback address hold too.
    now : datetime, optional
        From when on the certificates hold; None: the clock's.

    Returns
    -------
    list of str
        The names that are new.

    Raises
    ------
    CertificateError
        If cryptography is missing, a name or the host cannot stand in a certificate, a file is
        missing beside another one or cannot be read or written, or the authority has ended. No
        file is changed then.
    """
    _require_names(names)
    _require_host(host)
    import_extra("cryptography", "security", "certificates", CertificateError)
    now = now or datetime.now(UTC)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        missing = [name for name in names if not Identity(name).exists(folder)]
        made = [] if Identity(AUTHORITY).exists(folder) else [AUTHORITY]
        if made:
            _make_authority(folder, now)
        authority = _valid_authority(folder, now)
        authority_key = _authority_key(folder, authority, missing) if missing else None
        for name in missing:
            assert authority_key is not None
            key = _new_key()
            hosts = [host, "localhost", "127.0.0.1"] if name == names[0] else []
            certificate = _signed(name, key, authority, authority_key, hosts, now)
            _write(folder, name, certificate, key)
    except OSError as error:
        raise CertificateError(
            f"cannot write certificates to {folder}: {error.strerror}; a folder that can be "
            "written is needed"
        ) from error
    return [*made, *missing]


def certificate_warnings(
    folder: Path, names: Sequence[str], *, host: str, now: datetime | None = None
) -> list[str]:
    """Return what is wrong with certificates that were kept, a sentence each, with what to do.

    Parameters
    ----------
    folder : Path
        That `make_certificates` has filled.
    names : sequence of str
        Of the machines, the one that is listened on first.
    host : str
        Name or address that the others are to connect to.
    now : datetime, optional
        Whether they have ended then; None: the clock's.

    Returns
    -------
    list of str
        Empty where nothing is wrong.

    Raises
    ------
    CertificateError
        If a file is no certificate.
    """
    authority = _certificate(folder, AUTHORITY)
    certificates = {name: _certificate(folder, name) for name in names}
    warnings = []
    ends = authority.not_valid_after_utc
    if any(each.not_valid_after_utc >= ends for each in certificates.values()):
        warnings.append(
            f"{AUTHORITY}.pem ends on {ends:%Y-%m-%d}, and with it all that it signed: move the "
            "whole folder away before, make it again and give every machine its new files"
        )
    for name, certificate in certificates.items():
        wrong = list(_wrong(certificate, authority, now or datetime.now(UTC)))
        if name == names[0] and host.lower() not in (holds := _hosts(certificate)):
            wrong.append(f"is of {', '.join(holds) or 'no host'} and not of --host {host}")
        if wrong:
            warnings.append(
                f"{name}.pem {' and '.join(wrong)}: move {name}.pem and {name}{KEY_SUFFIX}.pem "
                "away and call again for a new pair"
            )
        elif not Identity(name).key(folder).exists():
            warnings.append(
                f"{name}{KEY_SUFFIX}.pem is not here: its machine needs it; where it is lost, move "
                f"{name}.pem away and call again for a new pair"
            )
    return warnings


def _wrong(
    certificate: "x509.Certificate", authority: "x509.Certificate", now: datetime
) -> Iterator[str]:
    from cryptography.exceptions import InvalidSignature

    ends = certificate.not_valid_after_utc
    if ends <= now:
        yield f"ended on {ends:%Y-%m-%d}"
    elif ends - now <= ENDS_SOON:
        yield f"ends on {ends:%Y-%m-%d}"
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        yield f"is not signed by {AUTHORITY}.pem"


def _require_names(names: Sequence[str]) -> None:
    """Raise CertificateError for a name that is no part of a file's name or of a certificate."""
    counts = Counter(names)
    taken = sorted(each for each in counts if counts[each] > 1 or each == AUTHORITY)
    if taken:
        raise CertificateError(f"{', '.join(taken)} cannot name two machines or the authority")
    for name in names:
        if wrong := _name_error(name):
            raise CertificateError(f"a machine cannot be named {name!r}: {wrong}")


def _name_error(name: str) -> str:
    if not name or not name.isprintable() or set(name) & set(" /\\"):
        return "a name is one character or more, none of them a space, a slash or a control"
    if name.endswith(KEY_SUFFIX):  # NAME-key.pem is the key of NAME
        return f"{KEY_SUFFIX} at the end is a private key's; another end is needed"
    size = len(name.encode())
    if size > LONGEST_COMMON_NAME:
        return f"it has {size} bytes, and a certificate's name at most {LONGEST_COMMON_NAME}"
    return ""


def _require_host(host: str) -> None:
    """Raise CertificateError for what is neither an address nor a name as DNS has it."""
    if not (_is_address(host) or (_HOST.fullmatch(host) and len(host) <= LONGEST_HOST)):
        raise CertificateError(
            f"--host {host!r} is neither a host's name nor an address, e.g. shore.example.org or "
            "192.0.2.1; a name with other letters than a to z is given as DNS has it (xn--…)"
        )


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _make_authority(folder: Path, now: datetime) -> None:
    key = _new_key()
    _write(folder, AUTHORITY, _signed("pilewatch authority", key, None, key, [], now), key)


def _valid_authority(folder: Path, now: datetime) -> "x509.Certificate":
    authority = _certificate(folder, AUTHORITY)
    if authority.not_valid_after_utc <= now:
        raise CertificateError(
            f"{Identity(AUTHORITY).certificate(folder)} ended on "
            f"{authority.not_valid_after_utc:%Y-%m-%d}, and with it all that it signed: move the "
            "whole folder away, make it again and give every machine its new files"
        )
    return authority


def _certificate(folder: Path, name: str) -> "x509.Certificate":
    from cryptography import x509

    path = Identity(name).certificate(folder)
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError as error:
        other = "make all again" if name == AUTHORITY else "call again for a new pair"
        raise CertificateError(
            f"{path} is no certificate; move it and {name}{KEY_SUFFIX}.pem away and {other}"
        ) from error


def _authority_key(
    folder: Path, authority: "x509.Certificate", missing: Sequence[str]
) -> "EllipticCurvePrivateKey":
    """The key of the authority, which these names need."""
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    path = Identity(AUTHORITY).key(folder)
    if not path.exists():
        raise CertificateError(
            f"{path} is missing beside {AUTHORITY}.pem: put it back for as long as it takes to "
            f"sign {', '.join(missing)}"
        )
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise CertificateError(f"{path} is no private key without a password") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise CertificateError(f"{path} is not of the kind made here (P-256)")
    if key.public_key() != authority.public_key():
        raise CertificateError(f"{path} is not the key of {AUTHORITY}.pem; put the right one back")
    return key


def _new_key() -> "EllipticCurvePrivateKey":
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _signed(
    name: str,
    key: "EllipticCurvePrivateKey",
    authority: "x509.Certificate | None",
    authority_key: "EllipticCurvePrivateKey",
    hosts: Sequence[str],
    now: datetime,
) -> "x509.Certificate":
    """authority   None: this one is the authority itself"""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    is_authority = authority is None
    ends = now + timedelta(days=AUTHORITY_DAYS if is_authority else VALID_DAYS)
    if authority is not None:  # a certificate does not outlive its signer's
        ends = min(ends, authority.not_valid_after_utc)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if authority is None else authority.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCKS_DIFFER)
        .not_valid_after(ends)
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

    if _is_address(text):
        return x509.IPAddress(ipaddress.ip_address(text))
    return x509.DNSName(text)


def _hosts(certificate: "x509.Certificate") -> list[str]:
    """Names and addresses that a certificate holds for."""
    from cryptography import x509

    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return []
    return [str(each.value).lower() for each in found.value]


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
    with open(Identity(name).certificate(folder), "xb") as file:  # never over another file
        file.write(certificate.public_bytes(Encoding.PEM))
