"""A unit that comes back with other channels, or with the same ones in another order."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.messages import Message
from pipeline.viewer.drawing.entities import signal_paths
from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.tabs.signals import signals
from pipeline.viewer.view_parameters import ViewParameters
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import (
    DESCRIPTION,
    LAYOUT,
    START_NS,
    TURBINE,
    acceleration_block,
    foundation_posterior,
    modal_estimate,
)

BACKWARDS = tuple(range(7, -1, -1))


def with_columns(layout_id: str, columns: Sequence[int]) -> SensorLayout:
    """Some of the layout's channels, in an order of their own."""
    channels = tuple(LAYOUT.channels[column] for column in columns)
    return replace(LAYOUT, layout_id=layout_id, channels=channels)


TURNED = with_columns("turned", BACKWARDS)
SIX = with_columns("six", range(6))
SIGNAL = f"/{TURBINE}/signals/tower/acceleration"
BLOCKS = [
    acceleration_block(n, 10, rng) for rng in [np.random.default_rng(8)] for n in range(14)
]  # of 10 s


def restarted(
    blocks: Sequence[AccelerationBlock], layout: SensorLayout, session: str
) -> list[Message]:
    """The layout and the blocks, as of a unit that starts again with it."""
    columns = [LAYOUT.channel_names.index(name) for name in layout.channel_names]
    first = blocks[0].sequence
    return [
        layout,
        *(
            replace(
                block,
                session=session,
                layout_id=layout.layout_id,
                sequence=block.sequence - first,
                first_sample=(block.sequence - first) * len(block.samples),
                samples=block.samples[:, columns].copy(),
            )
            for block in blocks
        ),
    ]


def drawn(path: Path, messages: Iterable[Message]) -> Recorded:
    viewer = Viewer([RrdFile(path)], DESCRIPTION, session="s", strict=True)
    for message in messages:
        viewer.handle(message)
    viewer.close()
    return Recorded(path)


def at_seconds(recorded: Recorded, entity: str) -> np.ndarray:
    return (recorded.times_ns(entity) - START_NS) / NANOSECONDS


def test_a_unit_that_comes_back_with_fewer_channels_and_then_with_all_is_drawn_throughout(
    tmp_path: Path,
):
    messages = [LAYOUT, *BLOCKS[:4], *restarted(BLOCKS[4:8], SIX, "b")]
    messages += restarted(BLOCKS[8:], LAYOUT, "c")
    recorded = drawn(tmp_path / "s.rrd", messages)
    eight, six = recorded.scalars(SIGNAL), recorded.scalars(f"{SIGNAL}\\ six")
    assert (eight.shape[1], six.shape[1]) == (8, 6)
    assert at_seconds(recorded, f"{SIGNAL}\\ six")[[0, -1]].round().tolist() == [40.0, 80.0]
    times = at_seconds(recorded, SIGNAL)
    broken = times[np.isnan(eight).all(axis=1)]
    assert broken.tolist() == [80.0]  # no line from the first part to the last
    assert times.max() > 139.0


def test_blocks_of_two_widths_under_one_layouts_name_end_no_drawing(tmp_path: Path):
    narrow = [replace(block, samples=block.samples[:, :6].copy()) for block in BLOCKS[5:]]
    recorded = drawn(tmp_path / "s.rrd", [LAYOUT, *BLOCKS[:5], *narrow])
    assert at_seconds(recorded, SIGNAL).max() > 139.0


def test_names_of_a_later_layout_do_not_label_the_signals_before(tmp_path: Path):
    """Of the same channels in another order."""
    messages = [LAYOUT, *BLOCKS[:7], *restarted(BLOCKS[7:], TURNED, "b")]
    recorded = drawn(tmp_path / "s.rrd", messages)
    for entity, layout, blocks in (
        (SIGNAL, LAYOUT, BLOCKS[:7]),
        (f"{SIGNAL}\\ turned", TURNED, BLOCKS[7:]),
    ):
        names = [f"{name} [m/s²]" for name in layout.channel_names]
        assert recorded.series_names(entity) == names
        measured = np.concatenate([block.samples for block in blocks]).std(axis=0)
        shown = np.nanstd(recorded.scalars(entity), axis=0)
        columns = [LAYOUT.channel_names.index(name) for name in layout.channel_names]
        assert np.corrcoef(shown, measured[columns])[0, 1] > 0.95  # the filter takes some out


def test_a_plot_for_each_set_of_channels_and_none_twice():
    """Layouts that differ by their name alone share the plots."""
    again = replace(LAYOUT, layout_id="again")
    paths = signal_paths("/t", (LAYOUT, TURNED, again))
    assert paths[LAYOUT.layout_id] == paths["again"] != paths["turned"]
    tab = signals("/t", ViewParameters("t", (LAYOUT, TURNED, again), (), 50.0))
    plots = [str(view.name) for view in tab.contents[0].contents]
    assert [name.removesuffix(" [m/s²]").split(" of ")[1] for name in plots] == [
        *["unit tower, again"] * 2,
        *["unit tower, turned"] * 2,
    ]


def test_shapes_and_mac_of_a_turned_layout_are_those_of_the_same_window_read_as_described(
    tmp_path: Path,
):
    """Estimate and posterior of one window, their channels in the layout's order and backwards."""
    rng = np.random.default_rng(8)
    estimate = modal_estimate(0, rng)
    posterior = foundation_posterior(estimate, 1, rng)
    order = list(BACKWARDS)
    modes = tuple(replace(mode, shape=mode.shape[order]) for mode in estimate.modes)
    turned = replace(estimate, layout_id="turned", channels=TURNED.channel_names, modes=modes)
    backwards = replace(posterior, model_shapes=posterior.model_shapes[:, order])
    described = drawn(tmp_path / "a.rrd", [LAYOUT, *BLOCKS, estimate, posterior])
    read = drawn(tmp_path / "b.rrd", [LAYOUT, *BLOCKS, TURNED, turned, backwards])
    root = f"/{TURBINE}"
    for entity, component in (
        (f"{root}/shapes/3/motion/model", "LineStrips3D:strips"),
        (f"{root}/shapes/3/motion/identified", "Points3D:positions"),
        (f"{root}/mac/values", "Image:buffer"),
    ):
        (expected,), (found,) = (each.column(entity, component) for each in (described, read))
        np.testing.assert_allclose(np.array(found, float), np.array(expected, float), atol=1e-5)
