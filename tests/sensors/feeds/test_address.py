"""How a feed is named, and what is wrong with a name that is none."""

from pathlib import Path

import pytest

from sensors.feeds.address import is_feed, parsed
from sensors.feeds.protocol import FeedError


def test_an_mqtt_address_has_machine_topic_user_and_options() -> None:
    address = parsed("mqtts://unit-7@broker.example:8884/tower/+/acc/#?qos=2&ca=/etc/ca.pem")
    assert (address.scheme, address.tls) == ("mqtt", True)
    assert (address.user, address.host, address.port) == ("unit-7", "broker.example", 8884)
    assert address.path == "tower/+/acc/#"
    assert address.options == {"qos": "2", "ca": "/etc/ca.pem"}


@pytest.mark.parametrize(
    ("text", "port"),
    [
        ("mqtt://h/t", 1883),
        ("mqtts://h/t", 8883),
        ("scada+mqtt://h/t", 1883),
        ("scada+mqtts://h/t", 8883),
        ("seedlink://h/XX.T", 18000),
        ("mqtt://[::1]:99/t", 99),
        ("opcua://h", 4840),
        ("opc.tcp://h:4841/path", 4841),
        ("udp://:5005", 5005),
    ],
)
def test_every_protocol_has_its_port(text: str, port: int) -> None:
    assert is_feed(text)
    assert parsed(text).port == port


@pytest.mark.parametrize("text", ["replay:a.mcap", "live", "mqtt", "recordings/udp", "http://x/y"])
def test_other_sources_are_no_feeds(text: str) -> None:
    assert not is_feed(text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("http://h/t", "is no feed; one begins with mqtt://"),
        ("mqtt:h/t", "mqtt:h/t: write mqtt://h/t"),
        ("mqtt://h", "which topic, e.g. /tower/#"),
        ("mqtt:///t", "which machine"),
        ("mqtt://h:99999/t", "port '99999' is none"),
        ("udp://h", "port '' is none"),
        ("udp://:5005/x", "a port has no 'x'"),
        ("seedlink://h", "which stations"),
        ("scada+csv:", "which file"),
        ("mqtt://h/t?qso=1", "there is no option 'qso'; did you mean 'qos'"),
        ("udp://:5005?rate=-1", "rate=-1 is no positive number"),
    ],
)
def test_what_is_wrong_with_an_address_is_one_line(text: str, sentence: str) -> None:
    with pytest.raises(FeedError) as caught:
        parsed(text).number("rate")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_password_in_the_address_is_refused_and_not_repeated() -> None:
    with pytest.raises(FeedError, match="PILEWATCH_FEED_PASSWORD") as caught:
        parsed("mqtt://me:hunter2@h/t")
    assert "hunter2" not in str(caught.value)


def test_secrets_come_from_a_file_or_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PILEWATCH_FEED_KEY", "of the tower")
    assert parsed("udp://:5005").secret("key") == "of the tower"
    written = tmp_path / "key"
    address = parsed(f"udp://:5005?key-file={written}")
    with pytest.raises(FeedError, match="cannot be read: No such file"):
        address.secret("key")
    written.write_text("\n")
    with pytest.raises(FeedError, match="is empty"):
        address.secret("key")
    written.write_text("of the file\n")
    assert address.secret("key") == "of the file"
