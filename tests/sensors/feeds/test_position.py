"""How far a feed was published, on its way to disk."""

import os
from pathlib import Path

import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.position import FeedPosition


def test_a_position_is_whole_on_disk_before_it_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, synced = tmp_path / "position.json", []
    monkeypatch.setattr(
        os, "fsync", lambda file: synced.append((os.fstat(file).st_size, path.exists()))
    )
    position = FeedPosition(path)
    position.published(0, NANOSECONDS, 1e8)
    position.save()
    assert synced == [(path.stat().st_size, False)]
    assert FeedPosition(path).resumed_ns == NANOSECONDS
