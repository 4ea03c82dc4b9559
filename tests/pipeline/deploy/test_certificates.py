"""An authority of one's own, a certificate a machine, and what each may say."""

import json
import ssl
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.deploy.access import OWN, Unit, access_control, parse_unit, write_configurations
from pipeline.deploy.certificates import (
    CertificateError,
    Identity,
    certificate_warnings,
    make_certificates,
)
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    ModalEstimate,
    NodeStatus,
    StabilisationDiagram,
    WindowRejected,
)
from pipeline.streams import stream_of
from pipeline.transport.errors import TransportError
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from sensors.errors import InputError

NAMES = ["shore", "t1.tower", "viewer"]


def certificate(folder: Path, name: str) -> x509.Certificate:
    return x509.load_pem_x509_certificate(Identity(name).certificate(folder).read_bytes())


def test_every_machine_has_a_certificate_that_the_authority_signed(tmp_path: Path) -> None:
    assert make_certificates(tmp_path, NAMES, host="station.example") == ["ca", *NAMES]
    authority = certificate(tmp_path, "ca")
    for name in NAMES:
        signed = certificate(tmp_path, name)
        signed.verify_directly_issued_by(authority)
        common = signed.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
        assert [each.value for each in common] == [name]
        key = load_pem_private_key(Identity(name).key(tmp_path).read_bytes(), password=None)
        assert key.public_key() == signed.public_key()
        assert stat.S_IMODE(Identity(name).key(tmp_path).stat().st_mode) == 0o600
    hosts = certificate(tmp_path, "shore").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    assert hosts.value.get_values_for_type(x509.DNSName) == ["station.example", "localhost"]


def test_extensions_are_as_the_profile_of_certificates_has_them(tmp_path: Path) -> None:
    """RFC 5280: those that limit what a key may do are critical, those that help find it are not;
    an authority signs no other authority."""
    make_certificates(tmp_path, NAMES, host="localhost")
    authority, machine, unit = (certificate(tmp_path, name) for name in ("ca", *NAMES[:2]))
    critical = {"basicConstraints": True, "keyUsage": True, "subjectKeyIdentifier": False}
    of_machine = critical | {"authorityKeyIdentifier": False, "extendedKeyUsage": False}
    for each, expected in (
        (authority, critical),
        (unit, of_machine),
        (machine, of_machine | {"subjectAltName": False}),
    ):
        assert {one.oid._name: one.critical for one in each.extensions} == expected
        allowed = each.extensions.get_extension_for_class(x509.BasicConstraints).value
        signs = each is authority
        assert (allowed.ca, allowed.path_length) == ((True, 0) if signs else (False, None))
        usage = each.extensions.get_extension_for_class(x509.KeyUsage).value
        assert (usage.key_cert_sign, usage.crl_sign) == (signs, signs)
        assert usage.digital_signature is not signs
        others = ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement")
        assert not any(getattr(usage, other) for other in others)
    purposes = unit.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert {each._name for each in purposes} == {"clientAuth", "serverAuth"}


def test_a_certificate_is_valid_from_ten_minutes_before_for_as_long_as_its_page_has_it(
    tmp_path: Path,
) -> None:
    before = datetime.now(UTC).replace(microsecond=0)
    make_certificates(tmp_path, NAMES, host="localhost")
    after = datetime.now(UTC)
    clocks_differ = timedelta(minutes=10)
    for name, days in (("ca", 3650), (NAMES[1], 825)):
        made = certificate(tmp_path, name)
        assert before - clocks_differ <= made.not_valid_before_utc <= after - clocks_differ
        assert before <= made.not_valid_after_utc - timedelta(days=days) <= after


def test_what_exists_is_kept_and_a_new_unit_is_signed_by_the_same_authority(tmp_path: Path) -> None:
    make_certificates(tmp_path, NAMES, host="localhost")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert make_certificates(tmp_path, [*NAMES, "t2.tower"], host="localhost") == ["t2.tower"]
    assert {path: path.read_bytes() for path in before} == before
    certificate(tmp_path, "t2.tower").verify_directly_issued_by(certificate(tmp_path, "ca"))


def test_an_authority_that_is_none_is_one_line(tmp_path: Path) -> None:
    for name in ("ca.pem", "ca-key.pem"):
        (tmp_path / name).write_text("nonsense")
    with pytest.raises(CertificateError, match=r"ca\.pem is no certificate; move it and ca-key"):
        make_certificates(tmp_path, NAMES, host="localhost")


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CertificateError, match="a folder that can be written is needed"):
        make_certificates(tmp_path / "file", NAMES, host="localhost")


def test_a_unit_publishes_its_own_keys_alone_and_a_viewer_none() -> None:
    section = access_control([Unit("t1", "tower"), Unit("t2", "tower")], ["viewer"])
    assert section["default_permission"] == "deny"
    rules = {rule["id"]: rule for rule in section["rules"]}
    for rule in rules.values():
        if "put" in rule["messages"] and "ingress" in rule["flows"] and rule["id"] != OWN:
            turbine = rule["id"].split(".")[0]
            assert all(key.startswith(f"pilewatch/{turbine}/") for key in rule["key_exprs"])
    assert not any("put" in rules[r]["messages"] for r in ("viewer asks",))
    assert {policy["subjects"][0] for policy in section["policies"]} == {
        *("t1.tower", "t2.tower", "viewer", OWN)
    }


def allowed(section: dict[str, Any], who: str, message: str, flow: str, key: str) -> bool:
    """Whether the rules let a message on a key pass between the shore and a machine."""
    (named,) = [each for each in section["policies"] if each["subjects"] == [who]]
    rules = [each for each in section["rules"] if each["id"] in named["rules"]]
    fits = [
        each["permission"]
        for each in rules
        if message in each["messages"]
        and flow in each["flows"]
        and any(zenoh.KeyExpr(k).includes(zenoh.KeyExpr(key)) for k in each["key_exprs"])
    ]
    return "allow" in fits and "deny" not in fits


def test_the_shore_alone_acknowledges_and_only_to_the_unit_itself() -> None:
    section = access_control([Unit("t1", "tower"), Unit("t2", "tower")], ["viewer"], ["compute"])
    key = "pilewatch/t1/tower/recorded"
    assert allowed(section, OWN, "put", "ingress", key)
    assert allowed(section, "t1.tower", "declare_subscriber", "ingress", key)
    assert allowed(section, "t1.tower", "put", "egress", key)
    assert not allowed(section, "t1.tower", "put", "ingress", key)
    for other in ("t2.tower", "viewer", "compute"):
        assert not allowed(section, other, "put", "ingress", key)
        assert not allowed(section, other, "put", "egress", key)
        assert not allowed(section, other, "declare_subscriber", "ingress", key)


def test_a_machine_with_nodes_reads_samples_and_publishes_results_alone() -> None:
    section = access_control([Unit("t1", "tower")], ["viewer"], ["compute"])
    computed = (
        *(ModalEstimate, StabilisationDiagram, WindowRejected),
        *(FoundationPosterior, FoundationEvent, NodeStatus),
    )
    keys = [stream_of(kind).key.format(turbine="t1", node="updating") for kind in computed]
    for key in (*keys, *(f"{key}/@adv/pub/1" for key in keys)):
        assert allowed(section, "compute", "put", "ingress", key)
        assert allowed(section, "compute", "query", "egress", key)
        assert not allowed(section, "viewer", "put", "ingress", key)
    block = "pilewatch/t1/tower/acceleration"
    for key in (block, f"{block}/@adv/pub/1", "pilewatch/t1/scada"):
        assert allowed(section, "compute", "put", "egress", key)
        assert allowed(section, "compute", "query", "ingress", key)
        assert not allowed(section, "compute", "put", "ingress", key)


@pytest.mark.parametrize("text", ["t1", "t1/", "/tower", "t1/a/b", "t1/*"])
def test_a_unit_that_is_none_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match="is not TURBINE/UNIT"):
        parse_unit(text)


def test_the_configurations_are_ones_that_zenoh_reads(tmp_path: Path) -> None:
    written = write_configurations(
        tmp_path, [Unit("t1", "tower")], ["viewer"], ["compute"], host="localhost", port=7447
    )
    names = [path.stem for path in written]
    assert names == ["shore", "t1.tower", "compute", "viewer"]
    roles = [ZenohSettings(config_file=path).role for path in written]
    assert roles == ["router", "client", "client", "client"]
    assert ZenohSettings(config_file=written[1]).endpoints == ("tls/localhost:7447",)
    told = json.loads(written[1].read_text().partition("\n")[2])
    assert told["transport"]["link"]["tls"]["enable_mtls"] is True


def test_a_unit_and_a_machine_with_nodes_wait_for_a_shore_that_starts_later(tmp_path: Path) -> None:
    """A person who looks is told at once that no session answers."""
    written = write_configurations(
        tmp_path, [Unit("t1", "tower")], ["viewer"], ["compute"], host="localhost", port=7447
    )
    sections = [json.loads(path.read_text().partition("\n")[2]) for path in written]
    waits = [each.get("connect", {}).get("timeout_ms") == -1 for each in sections]
    assert [path.stem for path in written] == ["shore", "t1.tower", "compute", "viewer"]
    assert waits == [False, True, True, False]
    assert sections[1]["connect"]["exit_on_failure"] is False


@pytest.mark.parametrize("file", ["t1.tower-key.pem", "t1.tower.pem", "ca.pem"])
def test_a_certificate_that_cannot_be_read_is_named_before_the_session_opens(
    tmp_path: Path, file: str
) -> None:
    """Zenoh connects without it and reports that no session answers, or waits for ever."""
    names = ["shore", "t1.tower"]
    make_certificates(tmp_path, names, host="localhost")
    units = [Unit("t1", "tower")]
    _, path = write_configurations(tmp_path, units, [], host="localhost", port=7447)
    (tmp_path / file).write_text("nonsense")
    with pytest.raises(TransportError, match=rf"{file} has no certificate or key \(PEM\); .*json5"):
        ZenohBus(ZenohSettings(config_file=path))
    (tmp_path / file).unlink()
    (tmp_path / file).mkdir()  # root reads every file, and no folder
    with pytest.raises(TransportError, match=rf"cannot read .*{file}: Is a directory; .*json5"):
        ZenohBus(ZenohSettings(config_file=path))


def shake_hands(client: ssl.SSLObject, server: ssl.SSLObject, wires: list[ssl.MemoryBIO]) -> None:
    """Pass bytes between the two until both have finished."""
    to_server, from_server, to_client, from_client = wires
    waiting = [client, server]
    for _ in range(10):
        for side in list(waiting):
            try:
                side.do_handshake()
                waiting.remove(side)
            except ssl.SSLWantReadError:
                pass
            to_server.write(from_client.read())
            to_client.write(from_server.read())
        if not waiting:
            return
    raise AssertionError("the handshake does not end")


def test_pythons_strict_checks_accept_both_sides(tmp_path: Path) -> None:
    """VERIFY_X509_STRICT (RFC 5280: key identifiers, key usage) is the default from 3.13 on."""
    make_certificates(tmp_path, NAMES, host="station.example")
    contexts = {}
    for name, purpose in (
        ("shore", ssl.PROTOCOL_TLS_SERVER),
        ("t1.tower", ssl.PROTOCOL_TLS_CLIENT),
    ):
        context = contexts[name] = ssl.SSLContext(purpose)
        context.load_verify_locations(Identity("ca").certificate(tmp_path))
        identity = Identity(name)
        context.load_cert_chain(identity.certificate(tmp_path), identity.key(tmp_path))
        context.verify_mode = ssl.CERT_REQUIRED
        context.verify_flags |= ssl.VERIFY_X509_STRICT | ssl.VERIFY_X509_PARTIAL_CHAIN
    wires = [ssl.MemoryBIO() for _ in range(4)]
    to_server, from_server, to_client, from_client = wires
    server = contexts["shore"].wrap_bio(to_server, from_server, server_side=True)
    client = contexts["t1.tower"].wrap_bio(
        to_client, from_client, server_hostname="station.example"
    )
    shake_hands(client, server, wires)
    assert client.version() == "TLSv1.3"
    assert server.getpeercert()["subject"] == ((("commonName", "t1.tower"),),)


def test_the_command_writes_what_a_machine_with_nodes_needs(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["certificates", str(tmp_path), "--node", "office", "--json"])
    assert done.exit_code == 0
    assert str(tmp_path / "office.json5") in json.loads(done.stdout)["written"]


def contents(folder: Path) -> dict[str, bytes]:
    """Every file beside and below a folder, with what it holds."""
    return {str(path): path.read_bytes() for path in folder.parent.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--viewer", "shore-key"], "'shore-key': -key at the end is a private key's"),
        (["--viewer", "ca-key"], "'ca-key': -key at the end is a private key's"),
        (["--node", "t1.tower-key"], "'t1.tower-key': -key at the end is a private key's"),
        (["--unit", "t1/tower-key"], "'t1.tower-key': -key at the end is a private key's"),
        (["--viewer", "../evil"], "'../evil': a name is one character or more"),
        (["--viewer", "a b"], "'a b': a name is one character or more"),
        (["--viewer", "a\nb"], "a name is one character or more"),
        (["--node", ""], "'': a name is one character or more"),
        (["--viewer", "x" * 70], "it has 70 bytes, and a certificate's name at most 64"),
        (["--viewer", "ü" * 40], "it has 80 bytes, and a certificate's name at most 64"),
        (["--viewer", "ca"], "ca cannot name two machines or the authority"),
        (["--node", "shore"], "shore cannot name two machines or the authority"),
        (["--host", "bücher.example"], "'bücher.example' is neither a host's name nor an address"),
        (["--host", ""], "'' is neither a host's name nor an address"),
        (["--host", "shore:7447"], "'shore:7447' is neither a host's name nor an address"),
        (["--host", "x" * 64], "is neither a host's name nor an address"),
    ],
)
def test_a_name_that_cannot_be_a_machines_is_one_line_and_nothing_is_written(
    tmp_path: Path, options: list[str], reason: str
) -> None:
    folder = tmp_path / "certs"
    make_certificates(folder, ["shore", "t1.tower"], host="localhost")
    before = contents(folder)
    command = ["certificates", str(folder), "--unit", "t1/tower", "--unit", "t2/tower", *options]
    done = CliRunner().invoke(app, command)
    assert isinstance(done.exception, InputError)
    assert reason in str(done.exception)
    assert "\n" not in str(done.exception)
    assert contents(folder) == before


def test_a_viewer_may_be_named_as_the_shores_own_nodes_are(tmp_path: Path) -> None:
    """Zenoh refuses two subjects of one name: "Subject id must be unique"."""
    section = access_control([], ["own"])
    for kind in ("subjects", "rules"):
        ids = [each["id"] for each in section[kind]]
        assert len(ids) == len(set(ids))


def test_an_address_of_ipv6_stands_in_brackets_in_an_endpoint(tmp_path: Path) -> None:
    written = write_configurations(tmp_path, [], ["viewer"], host="2001:db8::1", port=7447)
    assert ZenohSettings(config_file=written[1]).endpoints == ("tls/[2001:db8::1]:7447",)


@pytest.mark.parametrize("name", ["ca", "t1.tower"])
def test_a_key_without_its_certificate_is_named_and_kept(tmp_path: Path, name: str) -> None:
    make_certificates(tmp_path, NAMES, host="localhost")
    Identity(name).certificate(tmp_path).unlink()
    before = contents(tmp_path)
    with pytest.raises(CertificateError, match=f"{name}.pem is missing beside .*{name}-key.pem"):
        make_certificates(tmp_path, [*NAMES, "t2.tower"], host="localhost")
    assert contents(tmp_path) == before


def test_an_authority_whose_key_is_off_line_is_kept_and_signs_nothing(tmp_path: Path) -> None:
    make_certificates(tmp_path, NAMES, host="localhost")
    Identity("ca").key(tmp_path).unlink()
    before = contents(tmp_path)
    assert make_certificates(tmp_path, NAMES, host="localhost") == []
    with pytest.raises(CertificateError, match=r"ca-key\.pem is missing .* sign t2\.tower"):
        make_certificates(tmp_path, [*NAMES, "t2.tower"], host="localhost")
    assert contents(tmp_path) == before


def test_a_key_of_another_authority_signs_nothing(tmp_path: Path) -> None:
    for place in ("one", "other"):
        make_certificates(tmp_path / place, NAMES, host="localhost")
    other = Identity("ca").key(tmp_path / "other").read_bytes()
    Identity("ca").key(tmp_path / "one").write_bytes(other)
    with pytest.raises(CertificateError, match=r"ca-key.pem is not the key of ca\.pem"):
        make_certificates(tmp_path / "one", [*NAMES, "t2.tower"], host="localhost")


def test_a_certificate_whose_key_has_gone_to_its_machine_is_kept(tmp_path: Path) -> None:
    make_certificates(tmp_path, NAMES, host="localhost")
    Identity("viewer").key(tmp_path).unlink()
    before = contents(tmp_path)
    assert make_certificates(tmp_path, NAMES, host="localhost") == []
    assert contents(tmp_path) == before
    (warning,) = certificate_warnings(tmp_path, NAMES, host="localhost")
    assert warning.startswith("viewer-key.pem is not here: its machine needs it")


def test_a_certificate_that_has_ended_is_named_with_its_day(tmp_path: Path) -> None:
    made = datetime(2021, 1, 1, tzinfo=UTC)
    make_certificates(tmp_path, NAMES, host="localhost", now=made)
    make_certificates(tmp_path, [*NAMES, "t2.tower"], host="localhost")
    ended = [
        f"{name}.pem ended on 2023-04-06: move {name}.pem and {name}-key.pem" for name in NAMES
    ]
    warnings = certificate_warnings(tmp_path, [*NAMES, "t2.tower"], host="localhost")
    assert [each.partition(" away")[0] for each in warnings] == ended
    soon = made + timedelta(days=800)
    warning = certificate_warnings(tmp_path, NAMES, host="localhost", now=soon)[0]
    assert warning.startswith("shore.pem ends on 2023-04-06: ")
    assert certificate_warnings(tmp_path, NAMES, host="localhost", now=made) == []


def test_no_certificate_outlives_its_authority(tmp_path: Path) -> None:
    made = datetime(2021, 1, 1, tzinfo=UTC)
    make_certificates(tmp_path, NAMES, host="localhost", now=made)
    names = [*NAMES, "t2.tower"]
    late = made + timedelta(days=3000)
    make_certificates(tmp_path, names, host="localhost", now=late)
    ends = certificate(tmp_path, "ca").not_valid_after_utc
    assert certificate(tmp_path, "t2.tower").not_valid_after_utc == ends
    warning = certificate_warnings(tmp_path, names, host="localhost", now=made)[0]
    assert warning.startswith("ca.pem ends on 2030-12-30, and with it all that it signed: move the")
    before = contents(tmp_path)
    with pytest.raises(CertificateError, match=r"ca\.pem ended on 2030-12-30, and with it all"):
        make_certificates(tmp_path, [*names, "t3.tower"], host="localhost", now=ends)
    assert contents(tmp_path) == before


def test_a_certificate_of_another_authority_is_named(tmp_path: Path) -> None:
    make_certificates(tmp_path, NAMES, host="localhost")
    for path in (Identity("ca").certificate(tmp_path), Identity("ca").key(tmp_path)):
        path.unlink()
    assert make_certificates(tmp_path, NAMES, host="localhost") == ["ca"]
    warnings = certificate_warnings(tmp_path, NAMES, host="localhost")
    assert [each.partition(":")[0] for each in warnings] == [
        f"{name}.pem is not signed by ca.pem" for name in NAMES
    ]


def test_another_host_than_the_certificates_is_named_on_the_commands_output(tmp_path: Path) -> None:
    command = ["certificates", str(tmp_path), "--unit", "t1/tower", "--host"]
    runner = CliRunner()
    assert (
        json.loads(runner.invoke(app, [*command, "old.example", "--json"]).stdout)["warnings"] == []
    )
    expected = (
        "shore.pem is of old.example, localhost, 127.0.0.1 and not of --host new.example: move "
        "shore.pem and shore-key.pem away and call again for a new pair"
    )
    assert expected in runner.invoke(app, [*command, "new.example"]).stdout.splitlines()
    told = json.loads(runner.invoke(app, [*command, "new.example", "--json"]).stdout)
    assert told["warnings"] == [expected]
    assert runner.invoke(app, [*command, "OLD.example", "--json"]).exit_code == 0
