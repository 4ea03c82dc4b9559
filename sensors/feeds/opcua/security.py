"""The security of an OPC UA channel: the client's own certificate, and the server's, pinned."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from sensors.feeds.address import FeedAddress
from sensors.feeds.protocol import FeedError

POLICIES = ("Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss")
MODES = {"sign": "Sign", "encrypt": "SignAndEncrypt"}


def check_security(address: FeedAddress) -> None:
    """Check that certificates and the security that they are for are both there.

    Raises
    ------
    FeedError
    """
    security = address.one_of("security", ("none", *MODES))
    address.one_of("policy", POLICIES)
    files = [name for name in ("cert", "key", "server") if name in address.options]
    if security == "none" and files:
        raise FeedError(f"{address.text}: {files[0]} is for security=sign or security=encrypt")
    if security == "none":
        return
    for name, whose in (
        ("cert", "this client's certificate"),
        ("key", "the key of this client's certificate"),
        ("server", "the server's certificate, which shows that it is the right one"),
    ):
        written = address.options.get(name)
        if written is None:
            raise FeedError(f"{address.text}: security={security} needs {name}=FILE, {whose}")
        if not Path(written).is_file():
            raise FeedError(f"{address.text}: {name}={written}: no such file")


async def secure(client: Any, address: FeedAddress) -> None:
    """Choose the channel that an address wants, after the server's own list of what it offers.

    Parameters
    ----------
    client : asyncua.Client
        Not connected yet.
    address : FeedAddress
        Its options name security, policy and certificates.

    Raises
    ------
    FeedError
        If the server does not offer that, or is not the one whose certificate is named.
    """
    ua = import_module("asyncua.ua")
    security = address.one_of("security", ("none", *MODES))
    policy = address.one_of("policy", POLICIES) if security in MODES else "None"
    mode = getattr(ua.MessageSecurityMode, MODES.get(security, "None_"))
    offered = await client.connect_and_get_server_endpoints()
    endpoint = _chosen(address, offered, mode, policy)
    _check_user(address, endpoint)
    if security not in MODES:
        return
    options = address.options
    try:
        client.application_uri = _application_uri(options["cert"]) or client.application_uri
        if not endpoint.ServerCertificate.startswith(_der(options["server"])):
            raise FeedError(f"{address.text}: the server shows another certificate")
        _check_key(address)
        await client.set_security(
            getattr(import_module("asyncua.crypto.security_policies"), f"SecurityPolicy{policy}"),
            options["cert"],
            options["key"],
            server_certificate=options["server"],
            mode=mode,
        )
    except FeedError:
        raise
    except (OSError, ValueError, TypeError, ua.UaError) as error:
        reason = " ".join(str(error).split())
        raise FeedError(f"{address.text}: its certificates cannot be used: {reason}") from error


def _chosen(address: FeedAddress, offered: Sequence[Any], mode: Any, policy: str) -> Any:
    for each in offered:
        if each.SecurityMode == mode and each.SecurityPolicyUri.endswith(f"#{policy}"):
            return each
    kinds = sorted({_described(each) for each in offered})
    raise FeedError(f"{address.text}: the server offers {' or '.join(kinds) or 'nothing'}")


def _described(endpoint: Any) -> str:
    """Return an endpoint's security, as an address writes it."""
    words = {name: word for word, name in MODES.items()}
    word = words.get(endpoint.SecurityMode.name, "none")
    policy = endpoint.SecurityPolicyUri.rpartition("#")[2]
    return f"security={word}" + ("" if word == "none" else f"&policy={policy}")


def _check_user(address: FeedAddress, endpoint: Any) -> None:
    wanted = "UserName" if address.user else "Anonymous"
    kinds = [each.TokenType.name for each in endpoint.UserIdentityTokens]
    if not kinds or wanted in kinds:
        return
    if address.user:
        raise FeedError(f"{address.text}: the server takes no user; leave {address.user}@ out")
    raise FeedError(
        f"{address.text}: the server wants a user: opcua://USER@HOST, and the password in "
        "PILEWATCH_FEED_PASSWORD or ?password-file=FILE"
    )


def _check_key(address: FeedAddress) -> None:
    """Check that the client's key is of the kind that OPC UA's policies want, and its own.

    Raises
    ------
    FeedError
        If it is not. ValueError or TypeError if it cannot be read.
    """
    serialization = import_module("cryptography.hazmat.primitives.serialization")
    rsa = import_module("cryptography.hazmat.primitives.asymmetric.rsa")
    written = address.options["key"]
    content = Path(written).read_bytes()
    is_text = content.startswith(b"-----")
    load = serialization.load_pem_private_key if is_text else serialization.load_der_private_key
    key = load(content, None)
    if not isinstance(key, rsa.RSAPrivateKey):
        raise FeedError(f"{address.text}: key={written} is no RSA key, as OPC UA needs it")
    shown = import_module("cryptography.x509").load_der_x509_certificate(
        _der(address.options["cert"])
    )
    if shown.public_key() != key.public_key():
        raise FeedError(
            f"{address.text}: key={written} is not the key of cert={address.options['cert']}"
        )


def _application_uri(path: str) -> str | None:
    """Return the URI that a certificate is for: a client has to use that one."""
    x509 = import_module("cryptography.x509")
    try:
        read = x509.load_der_x509_certificate(_der(path))
        names = read.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return None
    uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    return str(uris[0]) if uris else None


def _der(path: str) -> bytes:
    """Return a certificate's bytes, of PEM or DER."""
    content = Path(path).read_bytes()
    if not content.startswith(b"-----"):
        return content
    read = import_module("cryptography.x509").load_pem_x509_certificate(content)
    encoding = import_module("cryptography.hazmat.primitives.serialization").Encoding
    return bytes(read.public_bytes(encoding.DER))
