"""What has been recorded is known again, as far back as it is remembered, in any file."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.recording.latest_messages import Repetition, latest_payloads
from pipeline.recording.writer import Recorder, RecorderSettings
from pipeline.transport.codec import encode
from tests.pipeline.example_messages import block

PAYLOADS = st.lists(st.binary(max_size=2), max_size=60)


@given(PAYLOADS, PAYLOADS)
def test_everything_is_new_once(recorded: list[bytes], later: list[bytes]) -> None:
    repetition = Repetition(recorded)
    new = [payload for payload in later if not repetition.is_known("key", payload, kept=60)]
    assert new == [p for p in dict.fromkeys(later) if p not in recorded]


@given(st.lists(st.tuples(st.sampled_from("ab"), st.binary(max_size=1)), max_size=60))
def test_of_each_key_so_many_are_known_again_and_no_more(sent: list[tuple[str, bytes]]) -> None:
    repetition = Repetition()
    latest: dict[str, list[bytes]] = {"a": [], "b": []}
    kept = {"a": 3, "b": 7}
    for key, rest in sent:
        payload = key.encode() + rest  # no two keys carry the same bytes
        known = payload in latest[key][-kept[key] :]
        assert repetition.is_known(key, payload, kept=kept[key]) == known
        if not known:
            latest[key].append(payload)


def test_the_latest_messages_are_read_from_the_ends_of_several_parts(tmp_path: Path) -> None:
    parts = []
    for first in (0, 20, 40):
        part = tmp_path / f"from {first}.mcap"
        settings = RecorderSettings(chunk_duration=4.0)
        recorder = Recorder(part, metadata={}, clock=None, settings=settings)
        for sequence in range(first, first + 20):
            recorder.handle(block(sequence))
        recorder.close()
        parts.append(part)
    parts[0].write_bytes(b"no recording any more")
    for count, oldest in ((5, 55), (30, 30), (1000, 20)):
        expected = [encode(block(sequence)) for sequence in range(oldest, 60)]
        assert list(latest_payloads(parts, count)) == expected


def test_of_too_many_those_of_the_key_that_was_silent_longest_are_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.recording.latest_messages.MOST_KNOWN_MESSAGES", 50)
    repetition = Repetition()
    for number in range(100):  # a flood of keys; one that speaks all the time
        repetition.is_known(f"forged {number}", b"f%d" % number, kept=1200)
        repetition.is_known("tower", b"t%d" % number, kept=20)
    assert all(repetition.is_known("tower", b"t%d" % n, kept=20) for n in range(80, 100))
    assert repetition.is_known("forged 99", b"f99", kept=1200)
    assert not repetition.is_known("forged 0", b"f0", kept=1200)
