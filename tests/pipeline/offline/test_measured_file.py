"""A recording as one table."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import Message
from pipeline.offline.measured_file import measured_channels, recorded_channels
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.files.table import FileError
from tests.pipeline.example_messages import LAYOUT, block, recorded

BLOCKS = [block(n) for n in range(40)]
SAMPLES = np.concatenate([each.samples for each in BLOCKS])


def columns(layout: SensorLayout, chosen: list[int], **others: str) -> SensorLayout:
    """A layout with some of another one's channels."""
    channels = tuple(layout.channels[i] for i in chosen)
    return replace(layout, layout_id="others", channels=channels, **others)


def came_back(chosen: list[int], first: int = 20, layout_id: str = "others") -> list[Message]:
    """Blocks of a unit that starts again with those columns."""
    return [
        replace(
            each,
            session="session-2",
            layout_id=layout_id,
            sequence=each.sequence - first,
            first_sample=each.first_sample - 40 * first,
            samples=each.samples[:, chosen].copy(),
        )
        for each in BLOCKS[first:]
    ]


def two_units(blocks: Iterable[AccelerationBlock]) -> list[Message]:
    """Layouts and blocks of the same channels in two units, one of which starts again."""
    low, high = ([0, 1, 2, 3], [4, 5, 6, 7])
    halves: list[Message] = []
    for each in blocks:
        again = each.sequence >= 20
        halves.append(replace(each, unit="low", layout_id="l", samples=each.samples[:, low]))
        halves.append(
            replace(
                each,
                unit="high",
                layout_id="h",
                session="session-2" if again else "session-1",
                sequence=each.sequence % 20,
                first_sample=each.first_sample % 800,
                samples=each.samples[:, high],
            )
        )
    return [
        replace(columns(LAYOUT, low, unit="low"), layout_id="l"),
        replace(columns(LAYOUT, high, unit="high"), layout_id="h"),
        *halves,
    ]


def test_the_samples_of_one_unit_are_those_that_were_recorded(tmp_path: Path) -> None:
    """Nothing is resampled where nothing is joined, though stamps scatter by some ms."""
    blocks = [
        replace(each, start_ns=each.start_ns + 4_000_000 * (each.sequence % 2)) for each in BLOCKS
    ]
    found = recorded_channels([recorded(tmp_path / "a.mcap", [LAYOUT, *blocks])])
    assert found.table.names == LAYOUT.channel_names
    np.testing.assert_array_equal(found.table.samples, SAMPLES)
    assert found.layout == LAYOUT


def test_the_places_are_those_that_were_recorded_whatever_the_names_say(tmp_path: Path) -> None:
    channels = tuple(
        replace(each, elevation=each.elevation + 5.0, coupling="ac", corner_frequency=0.05)
        for each in LAYOUT.channels
    )
    layout = replace(LAYOUT, channels=channels)
    path = recorded(tmp_path / "a.mcap", [layout, *BLOCKS])
    assert measured_channels(path).layout == layout


def test_a_channel_keeps_its_column_where_its_unit_comes_back_with_another_order(
    tmp_path: Path,
) -> None:
    turned = list(range(7, -1, -1))
    later = [columns(LAYOUT, turned), *came_back(turned)]
    found = recorded_channels([recorded(tmp_path / "a.mcap", [LAYOUT, *BLOCKS[:20], *later])])
    np.testing.assert_array_equal(found.table.samples, SAMPLES)
    assert found.layout is not None
    assert found.layout.channels == LAYOUT.channels


def test_a_layout_that_changes_under_its_name_holds_for_the_blocks_after_it(
    tmp_path: Path,
) -> None:
    turned = list(range(7, -1, -1))
    layout = replace(columns(LAYOUT, turned), layout_id=LAYOUT.layout_id)
    later = [layout, *came_back(turned, layout_id=LAYOUT.layout_id)]
    found = recorded_channels([recorded(tmp_path / "a.mcap", [LAYOUT, *BLOCKS[:20], *later])])
    np.testing.assert_array_equal(found.table.samples, SAMPLES)


@pytest.mark.parametrize("first_has_all", [True, False])
def test_a_channel_that_its_unit_lacks_for_a_time_has_no_samples_then(
    tmp_path: Path, first_has_all: bool
) -> None:
    few = [0, 1, 2, 3, 4, 5]
    before: list[Message] = [LAYOUT, *BLOCKS[:20]]
    after: list[Message] = [columns(LAYOUT, few), *came_back(few)]
    if not first_has_all:
        before = [columns(LAYOUT, few), *came_back(few, first=0)[:20]]
        after = [LAYOUT, *BLOCKS[20:]]
    found = recorded_channels([recorded(tmp_path / "a.mcap", [*before, *after])])
    table = found.table
    assert table.names == LAYOUT.channel_names
    missing = np.isnan(table.samples)
    lacking = slice(800, None) if first_has_all else slice(None, 800)
    assert missing[lacking, 6:].all()
    assert missing.sum() == 800 * 2
    np.testing.assert_array_equal(table.samples[~missing], SAMPLES[~missing])
    assert found.layout is not None
    assert found.layout.channel_names == table.names


def test_blocks_without_a_layout_have_numbered_columns_as_many_as_the_widest(
    tmp_path: Path,
) -> None:
    blocks: list[Message] = [*BLOCKS[:20], *came_back([0, 1, 2])]
    found = recorded_channels([recorded(tmp_path / "a.mcap", blocks)])
    assert found.table.names == tuple(f"ch{i}" for i in range(1, 9))
    assert np.isnan(found.table.samples[800:, 3:]).all()
    assert found.layout is None


def test_a_channel_that_moved_is_named_and_one_in_another_unit_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    everything = list(range(8))
    for key, value in (("elevation", 44.0), ("unit", "m/s")):
        first = replace(LAYOUT.channels[0], **{key: value})  # type: ignore[arg-type]
        layout = columns(replace(LAYOUT, channels=(first, *LAYOUT.channels[1:])), everything)
        messages = [LAYOUT, *BLOCKS[:20], layout, *came_back(everything)]
        path = recorded(tmp_path / f"{key}.mcap", messages)
        if key == "unit":
            with pytest.raises(FileError, match=r"z41-fa of unit tower is in m/s², later in m/s;"):
                recorded_channels([path])
        else:
            found = recorded_channels([path])
            assert "z41-fa of unit tower is at 41 m, later it is at 44 m" in caplog.text
            assert found.layout is not None
            assert found.layout.channels == layout.channels


def test_a_block_that_does_not_fit_its_layout_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    narrow = replace(BLOCKS[7], samples=BLOCKS[7].samples[:, :5].copy())
    messages: list[Message] = [LAYOUT, *BLOCKS[:7], narrow, *BLOCKS[8:]]
    found = recorded_channels([recorded(tmp_path / "a.mcap", messages)])
    assert len(found.table.samples) == 39 * 40
    assert "1 of 40 blocks of unit tower are left out" in caplog.text


def test_units_are_joined_also_after_one_of_them_started_again(tmp_path: Path) -> None:
    found = recorded_channels([recorded(tmp_path / "a.mcap", two_units(BLOCKS))])
    assert found.layout is not None
    assert found.layout.channel_names == found.table.names
    names = [LAYOUT.channel_names.index(name) for name in found.table.names]
    ours, theirs = found.table.samples, SAMPLES[: len(found.table.samples), names]
    assert len(ours) > 39 * 40
    assert not np.isnan(ours[860:]).any()
    np.testing.assert_allclose(ours[900:1500], theirs[900:1500], atol=1e-6)


def test_units_without_a_layout_are_refused_in_one_line(tmp_path: Path) -> None:
    messages = two_units(BLOCKS)[1:]
    path = recorded(tmp_path / "a.mcap", messages)
    with pytest.raises(FileError, match="has no layout of unit low"):
        recorded_channels([path])


def test_of_several_turbines_the_one_that_is_named_is_read_else_the_first_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    other = replace(LAYOUT, turbine="t2", channels=LAYOUT.channels[:2])  # the same layout_id
    both: list[Message] = [LAYOUT, other]
    for each in BLOCKS:
        both += [each, replace(each, turbine="t2", samples=each.samples[:, :2] + 7)]
    path = recorded(tmp_path / "two.mcap", both)
    np.testing.assert_array_equal(measured_channels(path).table.samples, SAMPLES)
    assert "has blocks of 2 turbines, t1, t2; those of t1, the first, are read" in caplog.text
    found = measured_channels(path, turbine="t2")
    np.testing.assert_array_equal(found.table.samples, SAMPLES[:, :2] + np.float32(7))
    assert found.layout == other
    with pytest.raises(FileError, match="no acceleration blocks of 't3'; it has blocks of t1, t2"):
        measured_channels(path, turbine="t3")


def test_a_recording_is_read_over_all_its_files(tmp_path: Path) -> None:
    files = [
        recorded(tmp_path / "a.mcap", [LAYOUT, *BLOCKS[:20]]),
        recorded(tmp_path / "b.mcap", BLOCKS[18:]),  # the last two again
    ]
    found = recorded_channels(files).table
    np.testing.assert_array_equal(found.samples, SAMPLES)
    assert found.start_ns == BLOCKS[0].start_ns
    assert found.times is not None
    assert found.times[-1] == pytest.approx(
        (BLOCKS[-1].end_ns - found.start_ns) / NANOSECONDS - 1 / 40
    )
