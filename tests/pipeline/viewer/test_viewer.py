"""A session ends up in the .rrd: every stream, with its units, at its time."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from pipeline.messages import (
    FoundationPosterior,
    FoundationTruth,
    ModalEstimate,
    RelativeStiffness,
)
from pipeline.viewer.blueprint import session_blueprint, turbine_tabs
from pipeline.viewer.drawing.tower import CLEARANCE, SENSOR_LABELS, label_distance
from pipeline.viewer.outputs.outputs import ConnectedViewer, RrdFile, ViewerError
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.display_signals import DISPLAY_RATE
from pipeline.viewer.pictures.scene import DRAWN_HEIGHT, outline
from pipeline.viewer.tabs.modes import shapes_view
from pipeline.viewer.turbine_view import MOST_AHEAD, TurbineView
from pipeline.viewer.update_rates import TO_FILE
from pipeline.viewer.view_parameters import GROUND, ViewParameters, time_series, with_margins
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.structure.description import bare_mast
from tests.pipeline.example_estimates import estimate, mode
from tests.pipeline.viewer.conftest import record
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import (
    DESCRIPTION,
    LAYOUT,
    REFERENCE_MODES,
    START_NS,
    TRUE_RATIOS,
    TURBINE,
    WINDOW,
    Episode,
    acceleration_block,
    change_event,
    node_status,
    session,
)

ROOT = f"/{TURBINE}"
SIGNAL = f"{ROOT}/signals/tower/acceleration"


def test_everything_of_a_turbine_lies_below_its_name_on_the_sensor_clock(recorded: Recorded):
    assert all(entity.startswith(ROOT) for entity in recorded.entities)
    assert recorded.timelines == {"time"}
    for entity in (SIGNAL, f"{ROOT}/status", f"{ROOT}/events"):
        times = recorded.times_ns(entity)
        assert times[0] >= START_NS
        assert times[-1] <= START_NS + 3 * WINDOW * NANOSECONDS


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_file_without_an_index_has_the_same_rows(recorded: Recorded, tmp_path: Path):
    other = record(tmp_path / "live.rrd", Episode(rejected=(1,)), indexed=False)
    assert other.entities == recorded.entities
    assert other.n_blueprints == recorded.n_blueprints
    for entity in (SIGNAL, f"{ROOT}/foundation/k22/posterior"):
        assert np.array_equal(other.times_ns(entity), recorded.times_ns(entity))
        np.testing.assert_array_equal(other.scalars(entity), recorded.scalars(entity))
    assert other.path.stat().st_size < recorded.path.stat().st_size


USED = (0, 2)  # windows of the recorded session; one is rejected
STREAMS = {  # of every session with a posterior: its unit, whether it has a row a window
    "signals/tower/acceleration": ("m/s²", False),
    "frequencies/identified/m2": ("Hz", True),
    "modes/2/identified": ("Hz", True),
    "modes/2/model": ("Hz", True),
    "modes/2/damping": ("%", True),
    **{f"foundation/{name}/posterior": ("-", True) for name in ("k11", "k22", "k12", "sigma")},
    **{f"foundation/{name}/truth": ("-", True) for name in ("k11", "k22", "k12")},
    **{f"posterior_width/{name}": ("%", True) for name in ("k11", "k22", "k12", "sigma")},
    "change/probability": ("-", True),
    "health/lost/identification": ("-", False),
    "health/behind/identification": ("s", False),
}


@pytest.mark.parametrize("path", STREAMS)
def test_every_stream_is_there_with_its_unit_at_its_times(recorded: Recorded, path: str):
    unit, by_window = STREAMS[path]
    entity = f"{ROOT}/{path}"
    rows, times = recorded.scalars(entity), recorded.times_ns(entity)
    names = recorded.series_names(entity)
    assert all(name.endswith(f"[{unit}]") for name in names)
    assert rows.reshape(len(times), -1).shape[1] == len(names)
    if by_window:
        assert times.tolist() == [START_NS + (k + 1) * WINDOW * NANOSECONDS for k in USED]
    else:
        assert START_NS <= times[0] < times[-1] <= START_NS + 3 * WINDOW * NANOSECONDS


def test_every_series_that_is_drawn_names_its_unit(recorded: Recorded):
    drawn = [each for each in recorded.entities if recorded.has_scalars(each)]
    assert len(drawn) > 50
    without = {
        entity: name
        for entity in drawn
        for name in recorded.series_names(entity)
        if not name.endswith("]")
    }
    assert without == {}


def test_a_blueprint_is_in_the_file_from_the_first_block_and_one_with_margins_at_the_end(
    recorded: Recorded,
):
    assert recorded.n_blueprints == 2


def test_plots_of_a_finished_session_have_room_for_their_first_date_and_their_legend():
    plain, legend = time_series("/a", "a"), time_series("/b", "b", "LeftTop")
    with_margins(rrb.Horizontal(rrb.Vertical(plain), legend), (1000, 2000))
    ranges = [
        view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()[0]
        for view in (plain, legend)
    ]
    assert [(each["start"], each["end"]) for each in ranges] == [(950, 2050), (800, 2050)]


def test_accelerations_are_drawn_at_twenty_hertz_with_one_named_series_per_channel(
    recorded: Recorded,
):
    names = recorded.series_names(SIGNAL)
    assert names == [f"{channel} [m/s²]" for channel in LAYOUT.channel_names]
    times = recorded.times_ns(SIGNAL)
    assert recorded.scalars(SIGNAL).shape == (len(times), len(names))
    steps = np.diff(times)
    assert np.sum(steps == round(NANOSECONDS / DISPLAY_RATE)) > 0.999 * len(steps)


def test_a_gap_breaks_the_lines_instead_of_bridging_it(recorded: Recorded):
    broken = np.isnan(recorded.scalars(SIGNAL)).all(axis=1)
    gap_start = START_NS + (WINDOW + 60) * NANOSECONDS
    assert list(recorded.times_ns(SIGNAL)[broken]) == [gap_start]


def test_displayed_accelerations_follow_the_measured_ones_on_a_coarse_step(recorded: Recorded):
    shown, times = recorded.scalars(SIGNAL)[:150], recorded.times_ns(SIGNAL)[:150]
    block = acceleration_block(0, 10, np.random.default_rng(8))
    measured = block.samples[(times - block.start_ns) * 40 // NANOSECONDS]
    for channel in range(4):  # side-side has hardly more than noise here
        assert np.corrcoef(shown[:, channel], measured[:, channel])[0, 1] > 0.8
    assert (shown * 2.0**20 == np.round(shown * 2.0**20)).all()  # of the 24 bits some are zero


def test_posterior_bands_are_ratios_to_nominal_with_the_truth_beside_them(recorded: Recorded):
    ends = [START_NS + n * WINDOW * NANOSECONDS for n in (1, 3)]
    for name, ratio in zip(("k11", "k22", "k12"), TRUE_RATIOS, strict=True):
        path = f"{ROOT}/foundation/{name}"
        assert recorded.series_names(f"{path}/posterior") == [
            f"{name} 5 % [-]",
            f"{name} median [-]",
            f"{name} 95 % [-]",
        ]
        bands = recorded.scalars(f"{path}/posterior")
        assert list(recorded.times_ns(f"{path}/posterior")) == ends
        assert (np.diff(bands, axis=1) > 0).all()
        assert bands[1, 2] - bands[1, 0] < bands[0, 2] - bands[0, 0]  # more windows, narrower
        assert recorded.scalars(f"{path}/truth") == pytest.approx(ratio)
    assert len(recorded.scalars(f"{ROOT}/foundation/sigma/posterior")) == 2


def test_without_a_truth_no_truth_is_drawn(tmp_path: Path):
    recorded = record(tmp_path / "s.rrd", Episode(n_windows=1, truth=False))
    assert recorded.column(f"{ROOT}/foundation/k11/truth", "Scalars:scalars") == []
    assert recorded.column(f"{ROOT}/foundation/joint/truth", "LineStrips2D:strips") == [[]]


def test_every_reference_mode_has_a_track_of_identified_over_model(recorded: Recorded):
    for name, _, frequency, _ in REFERENCE_MODES:
        model = recorded.scalars(f"{ROOT}/modes/{name}/model")
        assert model == pytest.approx(frequency)
        band = recorded.column(f"{ROOT}/modes/{name}/identified", "Scalars:scalars")
        if name == "1":  # never found
            assert band == []
        else:
            low, middle, high = np.array(band).T
            assert middle == pytest.approx((low + high) / 2)
            assert np.all((low < middle) & (np.abs(middle / frequency - 1) < 0.03))


def test_the_models_track_is_of_the_structure_that_was_inferred(tmp_path: Path):
    """As in the tables: a pair's model frequency; the described structure's is another."""
    messages = list(session(Episode(n_windows=1)))
    estimate = next(each for each in messages if isinstance(each, ModalEstimate))
    posterior = next(each for each in messages if isinstance(each, FoundationPosterior))
    pairs = tuple(
        replace(pair, model_frequency=0.99 * pair.model_frequency)
        for pair in posterior.pairs
        if pair.model != "9"
    )
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for message in (LAYOUT, estimate, replace(posterior, pairs=pairs, structure="uncertain")):
        viewer.handle(message)
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    described = dict(zip(posterior.model_labels, posterior.model_frequencies, strict=True))
    (drawn,) = recorded.scalars(f"{ROOT}/modes/5/model")
    assert drawn == pytest.approx(0.99 * described["5"], rel=1e-6)
    assert np.isnan(recorded.scalars(f"{ROOT}/modes/9/model")).all()


def test_tracks_are_whole_when_the_identification_runs_ahead_of_the_updating(tmp_path: Path):
    recorded = record(tmp_path / "ahead.rrd", Episode(ahead=True))
    times = recorded.times_ns(f"{ROOT}/modes/5/identified")
    assert len(np.unique(times)) == 3


def test_damping_is_drawn_in_percent(recorded: Recorded):
    damping = recorded.scalars(f"{ROOT}/modes/5/damping")
    assert damping[:, 0] == pytest.approx(0.8, abs=0.4)
    assert all(name.endswith("[%]") for name in recorded.series_names(f"{ROOT}/modes/5/damping"))


def test_identified_shape_lies_on_the_model_shape(recorded: Recorded):
    for name in ("2", "4", "9"):
        motion = f"{ROOT}/shapes/{name}/motion"
        dots = np.array(recorded.column(f"{motion}/identified", "Points3D:positions")[-1])
        (line,) = recorded.column(f"{motion}/model", "LineStrips3D:strips")[-1]
        assert list(dots[:, 2]) == [41.0, 80.0, 106.0, 145.0]
        assert np.abs(dots - np.array(line)).max() < 0.05 * 20.0  # 5 % of the drawn swing [m]


def test_two_modes_of_one_pair_stand_at_the_model_modes_whose_shapes_they_have(tmp_path: Path):
    messages = list(session(Episode(n_windows=1)))
    estimate = next(each for each in messages if isinstance(each, ModalEstimate))
    posterior = next(each for each in messages if isinstance(each, FoundationPosterior))
    fore_aft = replace(estimate.modes[0], frequency=0.158, pair_id="m1+m2")
    side_side = replace(fore_aft, name="m1", shape=np.roll(fore_aft.shape, 4))
    both = replace(estimate, modes=(side_side, fore_aft, *estimate.modes[1:]))
    mean = replace(posterior.pairs[0], identified="m1+m2", frequency=0.158)
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for message in (LAYOUT, both, replace(posterior, pairs=(mean, *posterior.pairs[1:]))):
        viewer.handle(message)
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    for label, across, direction in (("1", 0, "SS"), ("2", 1, "FA")):
        assert recorded.scalars(f"{ROOT}/modes/{label}/identified")[0, 1] == 0.158
        caption, *_ = recorded.column(f"{ROOT}/shapes/{label}/caption", "Points3D:labels")
        assert caption[:2] == [f"{direction} ≈", "0.158"]
        motion = f"{ROOT}/shapes/{label}/motion/identified"
        dots = np.abs(np.array(recorded.column(motion, "Points3D:positions")[-1]))
        assert dots[:, across].max() < 0.1 * dots[:, 1 - across].max()


def test_a_posterior_that_comes_again_keeps_its_windows_identified_shapes(tmp_path: Path):
    """After kills: the identification counts its windows from 0 again, and the updating repeats its
    last posterior. On main before, the second one erased all identified dots."""
    messages = list(session(Episode(n_windows=2)))
    *_, estimate = (each for each in messages if isinstance(each, ModalEstimate))
    *_, posterior = (each for each in messages if isinstance(each, FoundationPosterior))
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for message in (LAYOUT, replace(estimate, window=0), posterior, posterior):
        viewer.handle(message)
    viewer.close()
    motion = f"{ROOT}/shapes/5/motion/identified"
    drawn = Recorded(tmp_path / "s.rrd").column(motion, "Points3D:positions")
    assert [len(dots) for dots in drawn] == [len(drawn[0])] * len(drawn)
    assert len(drawn[-1]) > 0


def test_a_mode_that_is_paired_later_gets_its_place_in_the_models_order(tmp_path: Path):
    """Of a description without reference modes; two of one pair get both their places."""
    messages = list(session(Episode(n_windows=1)))
    estimate = next(each for each in messages if isinstance(each, ModalEstimate))
    posterior = next(each for each in messages if isinstance(each, FoundationPosterior))
    own = replace(DESCRIPTION, reference_modes=())
    recording = rr.RecordingStream("labels")
    view = TurbineView(recording, TURBINE, own, rates=TO_FILE)
    view.draw_layout(LAYOUT)
    shown = []
    for window, models in enumerate((("5", "9"), ("4", "9"))):
        pairs = tuple(pair for pair in posterior.pairs if pair.model in models)
        names = [pair.identified for pair in pairs]
        modes = tuple(mode for mode in estimate.modes if mode.name in names)
        view.draw_estimate(replace(estimate, window=window, modes=modes))
        view.draw_posterior(replace(posterior, window=window, pairs=pairs))
        shown.append(view.parameters.modes)
    assert shown == [("5", "9"), ("4", "5", "9")]
    assert view.copy_to(rr.RecordingStream("copy")).parameters.modes == ("4", "5", "9")


def test_fore_aft_modes_swing_along_x_and_side_side_modes_along_y(recorded: Recorded):
    for name, direction, _, _ in REFERENCE_MODES:
        ((line,), *_) = recorded.column(f"{ROOT}/shapes/{name}/motion/model", "LineStrips3D:strips")
        x, y, _ = np.abs(np.array(line)).max(axis=0)
        assert (x > 0 and y == 0) if direction == "FA" else (y > 0 and x == 0)


def test_shapes_swing_and_stand_at_full_swing_when_a_posterior_comes(recorded: Recorded):
    motion = f"{ROOT}/shapes/2/motion"
    factors = np.array(recorded.column(motion, "Transform3D:scale"))[:, 0]
    times = recorded.times_ns(motion)
    assert factors[[0, -1]] == pytest.approx(1.0)
    assert [times[0], times[-1]] == [START_NS + n * WINDOW * NANOSECONDS for n in (1, 3)]
    assert factors.min() == pytest.approx(-1.0)
    assert np.abs(factors).min() > 0.1  # never flat


def test_joint_posterior_has_every_pair_of_stiffnesses(recorded: Recorded):
    draws = np.array(recorded.column(f"{ROOT}/foundation/joint/draws", "Points2D:positions")[-1])
    assert 0.97 * 3 * 800 < len(draws) <= 3 * 800
    text_labels = recorded.column(f"{ROOT}/foundation/joint/text", "Points2D:labels")[-1]
    assert {"k11 / nominal [-]", "k22 / nominal [-]", "k12 / nominal [-]"} <= set(text_labels)
    assert text_labels.count("3 % of prior width") == 3


def test_posterior_width_over_prior_width_is_drawn_in_percent(recorded: Recorded):
    for name in ("k11", "k22", "k12", "sigma"):
        assert recorded.scalars(f"{ROOT}/posterior_width/{name}") == pytest.approx(3.0)
        (shown,) = recorded.series_names(f"{ROOT}/posterior_width/{name}")
        assert shown.endswith("[%]")


def test_the_tower_leans_on_its_springs_in_the_colours_of_nominal_posterior_and_truth(
    recorded: Recorded,
):
    pile = f"{ROOT}/foundation/pile"
    counts = {"fixed": 5, "springs": 2, "nominal": 1, "posterior": 3, "truth": 1}
    for name, count in counts.items():
        *_, lines = recorded.column(f"{pile}/{name}", "LineStrips2D:strips")
        assert len(lines) == count
    orders = [recorded.column(f"{pile}/{name}", "LineStrips2D:draw_order")[-1] for name in counts]
    assert orders == sorted(orders)  # a narrow posterior does not hide the truth
    assert orders[-1] > orders[-2]


def test_a_change_gets_its_mark_and_its_sizes_where_there_is_one(tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for message in [*session(Episode(n_windows=2, block=60)), change_event(1)]:
        viewer.handle(message)
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    end = START_NS + 2 * WINDOW * NANOSECONDS
    assert list(recorded.times_ns(f"{ROOT}/change/noticed")) == [end]
    assert recorded.scalars(f"{ROOT}/change/noticed") == pytest.approx(0.998)
    assert recorded.scalars(f"{ROOT}/change/size/k22")[0] == pytest.approx([-12.0, -10.0, -8.0])
    assert recorded.series_names(f"{ROOT}/change/size/k22")[1] == "k22 change [%]"
    indicators = recorded.column(f"{ROOT}/indicators/text", "Points2D:labels")[-1]
    assert "foundation: changed" in indicators


def test_the_size_of_a_change_is_drawn_again_with_every_posterior_since(tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    messages = list(session(Episode(n_windows=2, block=60)))
    last = next(each for each in reversed(messages) if isinstance(each, FoundationPosterior))
    end_ns = last.time_ns + WINDOW * NANOSECONDS
    revised = RelativeStiffness("k22", 0.91, 0.9, 0.92, last.time_ns)
    later = replace(last, time_ns=end_ns, relative=(revised,))
    for message in [*messages, change_event(1), later]:
        viewer.handle(message)
    viewer.close()
    sizes = Recorded(tmp_path / "s.rrd").scalars(f"{ROOT}/change/size/k22")
    assert sizes == pytest.approx(np.array([[-12.0, -10.0, -8.0], [-10.0, -9.0, -8.0]]))


def test_every_posterior_has_a_probability_of_change(recorded: Recorded):
    assert recorded.scalars(f"{ROOT}/change/probability").shape == (2, 1)
    assert recorded.series_names(f"{ROOT}/change/probability") == ["probability [-]"]


def test_a_session_without_a_change_has_no_sizes_of_changes(recorded: Recorded):
    assert not any("/change/size" in entity for entity in recorded.entities)


def test_the_tower_stands_from_the_mudline_to_its_top(recorded: Recorded):
    (vertices,) = recorded.column(f"{ROOT}/tower/structure", "Mesh3D:vertex_positions", static=True)
    heights = np.array(vertices)[:, 2]
    assert [heights.min(), heights.max()] == [-30.0, 145.0]
    (blades,) = recorded.column(f"{ROOT}/tower/blades", "LineStrips3D:strips", static=True)
    assert len(blades) == 3
    (sensors,) = recorded.column(f"{ROOT}/tower/sensors/tower", "Points3D:positions", static=True)
    assert [z for _, _, z in sensors] == [41.0, 80.0, 106.0, 145.0]


def test_status_and_events_tell_the_session(recorded: Recorded):
    (*_, (last,)) = recorded.column(f"{ROOT}/status", "TextDocument:text")
    assert "Foundation known" in last
    (*_, (health,)) = recorded.column(f"{ROOT}/health/text", "TextDocument:text")
    for text_labels in ("2 identified", "1 rejected", "gap of 60.0 s in unit tower"):
        assert text_labels in health
    events = [text for (text,) in recorded.column(f"{ROOT}/events", "TextLog:text")]
    assert sum("window 1 rejected" in text for text in events) == 1
    assert sum("÷ nominal" in text for text in events) == 2
    levels = [level for (level,) in recorded.column(f"{ROOT}/events", "TextLog:level")]
    assert levels.count("warning") == 3  # the gap, the rejected window, a warning of both others
    assert set(levels) <= {
        "info",
        "warning",
        "error",
    }  # none that Rerun has a colour of its own for
    assert sum(text.split("  ")[1].startswith("close-modes: 0.157") for text in events) == 1


def test_the_last_window_has_its_spectra_and_its_mac_matrix(recorded: Recorded):
    *_, spectra = recorded.column(f"{ROOT}/spectrum/channels", "LineStrips2D:strips")
    *_, lines = recorded.column(f"{ROOT}/spectrum/modes", "LineStrips2D:strips")
    assert len(spectra) == len(LAYOUT.channels)
    assert len(lines) == 2 * 10  # of the ten modes that the session finds, one in each panel
    assert len(recorded.column(f"{ROOT}/mac/values", "Image:buffer")) == 2  # windows not rejected


def test_every_window_has_its_poles_by_band_and_the_modes_taken_among_them(recorded: Recorded):
    poles = recorded.column(f"{ROOT}/stabilisation/poles", "Points2D:positions")
    assert [len(each) for each in poles] == [14 * 21] * 2  # windows not rejected
    *_, palette = recorded.column(f"{ROOT}/stabilisation/poles", "Points2D:colors")
    assert len(set(palette)) == 2
    *_, bars = recorded.column(f"{ROOT}/stabilisation/stds", "LineStrips2D:strips")
    *_, lines = recorded.column(f"{ROOT}/stabilisation/modes", "LineStrips2D:strips")
    assert [len(bars), len(lines)] == [14 * 21, 10]
    *_, text_labels = recorded.column(f"{ROOT}/stabilisation/text", "Points2D:labels")
    assert {"frequency [Hz]", "order [-]"} <= set(text_labels)


def test_every_node_has_its_losses_and_its_lag(recorded: Recorded):
    lost = recorded.scalars(f"{ROOT}/health/lost/identification")
    behind = recorded.scalars(f"{ROOT}/health/behind/identification")
    assert lost.max() == 0
    assert behind[-1] == 0.0


def test_a_node_has_a_row_a_minute_in_a_file_however_often_it_reports_with_its_worst_delay(
    tmp_path: Path,
):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    viewer.handle(LAYOUT)
    rng = np.random.default_rng(8)
    for sequence in range(13):  # blocks of 10 s
        viewer.handle(acceleration_block(sequence, 10, rng))
        for behind in (0, 3 if sequence == 4 else 0, 0):
            viewer.handle(node_status("running", sequence - behind))
    viewer.close()
    path = f"{ROOT}/health/behind/identification"
    recorded = Recorded(tmp_path / "s.rrd")
    assert [(t - START_NS) // NANOSECONDS for t in recorded.times_ns(path)] == [10, 70, 130]
    assert recorded.scalars(path)[:, 0].tolist() == [0.0, 30.0, 0.0]


def test_blocks_that_a_unit_reports_as_faulty_make_an_event_when_drawn_together(
    tmp_path: Path,
):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    viewer.handle(LAYOUT)
    rng = np.random.default_rng(8)
    for sequence in range(4):
        block = acceleration_block(sequence, 10, rng)
        status = BlockStatus.SENSOR_FAULT if sequence == 2 else BlockStatus.OK
        viewer.handle(replace(block, status=status))
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    sensors = f"{ROOT}/tower/sensors/tower"
    times = [(t - START_NS) // NANOSECONDS for t in recorded.times_ns(sensors)]
    assert times == [0, 20, 30]  # healthy, faulty, healthy again
    lines = [text for (text,) in recorded.column(f"{ROOT}/events", "TextLog:text")]
    assert "00:00:20" in lines[0]
    assert lines[1].endswith("unit tower: none")


def test_an_untrusted_posterior_is_an_error_in_the_events(tmp_path: Path):
    recorded = record(tmp_path / "s.rrd", Episode(n_windows=1, trusted=False))
    assert ["error"] in recorded.column(f"{ROOT}/events", "TextLog:level")
    assert "NOT TRUSTED" in recorded.column(f"{ROOT}/status", "TextDocument:text")[-1][0]


def test_a_dead_channel_turns_its_sensor_into_the_colour_of_trouble(tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    viewer.handle(LAYOUT)
    rng = np.random.default_rng(8)
    block = acceleration_block(1, 10, rng)
    block.samples[:, 3] = np.nan  # z145-fa
    viewer.handle(acceleration_block(0, 10, rng))
    viewer.handle(block)
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    healthy, faulty_levels = recorded.column(f"{ROOT}/tower/sensors/tower", "Points3D:colors")
    assert healthy[:3] == faulty_levels[:3]
    assert healthy[3] != faulty_levels[3]


def test_a_day_of_eight_channels_takes_less_than_150_megabytes(tmp_path: Path):
    # The noise makes these signals compress badly. A file holds its layouts once.
    one, four = (
        record(tmp_path / f"{n}.rrd", Episode(n_windows=n, block=1)).path.stat().st_size
        for n in (1, 4)
    )
    assert one + (four - one) / 3 * 143 < 150e6


def test_every_day_has_a_file_of_its_own_that_stands_alone(tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    messages = list(session(Episode(n_windows=1)))
    day = 86_400 * NANOSECONDS
    blocks = [message for message in messages if isinstance(message, AccelerationBlock)]
    for message in [*messages, *(replace(b, start_ns=b.start_ns + day) for b in blocks)]:
        viewer.handle(message)
    viewer.close()
    first, second = Recorded(tmp_path / "s.rrd"), Recorded(tmp_path / "s-2026-01-02.rrd")
    assert first.times_ns(SIGNAL).max() < START_NS + day <= second.times_ns(SIGNAL).min()
    assert second.series_names(SIGNAL) == first.series_names(SIGNAL)
    assert f"{ROOT}/tower/structure" in second.entities
    assert second.n_blueprints == 2


def test_the_next_days_file_goes_on_with_the_sizes_of_a_change_and_the_first_frequencies(
    tmp_path: Path,
):
    day = 86_400 * NANOSECONDS
    messages = list(session(Episode(n_windows=1)))
    (estimated,) = (each for each in messages if isinstance(each, ModalEstimate))
    (posterior,) = (each for each in messages if isinstance(each, FoundationPosterior))
    blocks = [message for message in messages if isinstance(message, AccelerationBlock)]
    lower = replace(
        estimated,
        start_ns=estimated.start_ns + day,
        end_ns=estimated.end_ns + day,
        modes=tuple(replace(each, frequency=0.95 * each.frequency) for each in estimated.modes),
    )
    ratio = RelativeStiffness("k22", 0.9, 0.88, 0.92, START_NS)
    later = replace(posterior, time_ns=posterior.time_ns + day, relative=(ratio,))
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    next_day = [replace(block, start_ns=block.start_ns + day) for block in blocks]
    for message in [*messages, change_event(1), *next_day, lower, later]:
        viewer.handle(message)
    viewer.close()
    first, second = Recorded(tmp_path / "s.rrd"), Recorded(tmp_path / "s-2026-01-02.rrd")
    size, change = f"{ROOT}/change/size/k22", f"{ROOT}/frequencies/change/m5"
    assert second.scalars(size)[-1] == pytest.approx([-12.0, -10.0, -8.0])
    assert second.series_names(size) == first.series_names(size)
    assert second.scalars(change).ravel() == pytest.approx([-5.0])
    assert second.series_names(change) == first.series_names(change)


def test_the_spectra_of_a_turbine_with_two_units_are_of_both(tmp_path: Path):
    units = [
        replace(LAYOUT, layout_id=name, unit=name, channels=LAYOUT.channels[half])
        for name, half in (("a", slice(4)), ("b", slice(4, 8)))
    ]
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for unit in units:
        viewer.handle(unit)
    for message in session(Episode(n_windows=1)):
        if isinstance(message, AccelerationBlock):
            for unit, half in zip(units, np.hsplit(message.samples, 2), strict=True):
                name = unit.unit
                viewer.handle(replace(message, unit=name, layout_id=name, samples=half.copy()))
        elif isinstance(message, ModalEstimate):
            viewer.handle(replace(message, layout_id="a+b"))
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    (lines,) = recorded.column(f"{ROOT}/spectrum/channels", "LineStrips2D:strips")
    assert len(lines) == len(LAYOUT.channels)


def test_shapes_of_a_small_structure_are_drawn_as_tall_as_it_is(tmp_path: Path):
    """Of a model, and identified: axis and sensors are enlarged to DRAWN_HEIGHT."""
    foot = DESCRIPTION.mudline
    shrink = 50 / (DESCRIPTION.tower_top - foot)
    tubes = tuple(
        replace(tube, bottom=(tube.bottom - foot) * shrink, top=(tube.top - foot) * shrink)
        for tube in DESCRIPTION.tubes
    )
    small = replace(DESCRIPTION, tubes=tubes, water=None)
    channels = tuple(
        replace(each, elevation=(each.elevation - foot) * shrink) for each in LAYOUT.channels
    )
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], small, session="s", strict=True)
    for message in session(Episode(n_windows=1, truth=False)):
        is_layout = isinstance(message, type(LAYOUT))
        viewer.handle(replace(LAYOUT, channels=channels) if is_layout else message)
    viewer.close()
    recorded = Recorded(tmp_path / "s.rrd")
    ((line,),) = recorded.column(f"{ROOT}/shapes/3/motion/model", "LineStrips3D:strips")
    (dots,) = recorded.column(f"{ROOT}/shapes/3/motion/identified", "Points3D:positions")
    (sensors,) = recorded.column(f"{ROOT}/tower/sensors/tower", "Points3D:positions", static=True)
    for drawn in (line, dots):
        assert np.array(drawn)[:, 2] == pytest.approx(np.array(sensors)[:, 2])


def test_two_turbines_share_a_recording_side_by_side(tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    for turbine in ("north", "south"):
        viewer.handle(FoundationTruth(turbine, START_NS, *map(float, DESCRIPTION.nominal)))
    viewer.close()
    entities = Recorded(tmp_path / "s.rrd").entities
    assert {"/north/tower/structure", "/south/tower/structure"} <= entities


def test_a_broken_picture_is_logged_once_and_ends_no_session(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s")
    viewer.handle(LAYOUT)
    narrow = acceleration_block(0, 10, np.random.default_rng(8))
    one_channel_too_few = type(narrow)(
        *(getattr(narrow, name) for name in narrow.__slots__[:-2]), narrow.samples[:, :0]
    )
    with caplog.at_level(logging.ERROR):
        viewer.handle(one_channel_too_few)
        viewer.handle(object())  # type: ignore[arg-type]
        viewer.handle(node_status("stopped", 0))
        viewer.close()
        viewer.close()
    assert [record.levelname for record in caplog.records] == ["ERROR"]


def test_a_viewer_that_must_be_there_and_is_not_is_one_clear_line():
    nowhere = ConnectedViewer("rerun+http://127.0.0.1:1/proxy")
    with pytest.raises(ViewerError, match=r"no viewer listens there.*rerun --bind 127\.0\.0\.1"):
        Viewer([nowhere], DESCRIPTION, session="s", wait_for_viewer=True)


def test_a_file_that_cannot_be_written_is_one_clear_line(tmp_path: Path):
    (tmp_path / "folder.rrd").mkdir()
    with pytest.raises(ViewerError, match=r"folder\.rrd: cannot be written"):
        Viewer([RrdFile(tmp_path / "folder.rrd")], DESCRIPTION, session="s")


def test_a_unit_that_was_rewired_may_be_spoken_of_by_any_layout(tmp_path: Path):
    """Two layouts of one unit share their channels' names; an estimate names a third one."""
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="made-up", strict=True)
    viewer.handle(replace(LAYOUT, layout_id="before"))
    for message in session(Episode(n_windows=1)):
        lines_of_text = isinstance(message, ModalEstimate)
        viewer.handle(replace(message, layout_id="unheard of") if lines_of_text else message)
    viewer.close()


@pytest.fixture(scope="module")
def modes_only(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The session's blocks, truth and estimates, drawn without a structural model."""
    path = tmp_path_factory.mktemp("modes") / "s.rrd"
    structure = bare_mast(LAYOUT)
    viewer = Viewer([RrdFile(path)], structure, session="s", has_structure=False, strict=True)
    for message in session(Episode(n_windows=2)):
        if not isinstance(message, FoundationPosterior):
            viewer.handle(message)
    viewer.close()
    return Recorded(path)


def test_without_a_structure_identified_shapes_are_drawn_from_the_layout(
    modes_only: Recorded,
) -> None:
    for label in ("m2", "m5"):
        assert modes_only.column(f"{ROOT}/shapes/{label}/motion/model", "LineStrips3D:strips")
        assert modes_only.column(f"{ROOT}/shapes/{label}/motion", "Transform3D:scale")
    captions = modes_only.column(f"{ROOT}/shapes/m2/caption", "Points3D:labels")
    assert captions[-1][0] == "FA"


def test_without_a_structure_a_mode_that_the_last_window_lacks_has_no_shape(tmp_path: Path) -> None:
    recording = rr.RecordingStream("test", recording_id="lacking")
    recording.save(tmp_path / "s.rrd")
    view = TurbineView(recording, "t1", bare_mast(LAYOUT), rates=TO_FILE, has_structure=False)
    view.draw_layout(LAYOUT)
    both = [replace(mode(f, np.ones(8)), name=name) for f, name in [(0.16, "m1"), (0.9, "m2")]]
    for number, modes in enumerate([both, both[:1], both]):
        view.draw_estimate(estimate(*modes, number=number))
    recording.disconnect()
    drawn = Recorded(tmp_path / "s.rrd")
    captions = drawn.column("/t1/shapes/m2/caption", "Points3D:labels")
    assert captions == [["FA", "0.900"], ["–"], ["FA", "0.900"]]
    for part, component in [("model", "LineStrips3D:strips"), ("identified", "Points3D:positions")]:
        rows = drawn.column(f"/t1/shapes/m2/motion/{part}", component)
        assert [len(row) > 0 for row in rows] == [True, False, True]
    assert ["–"] not in drawn.column("/t1/shapes/m1/caption", "Points3D:labels")


def test_windows_that_no_posterior_answers_do_not_gather(tmp_path: Path) -> None:
    """Of a session that only tracks modes, and of windows that the updating refuses."""
    recording = rr.RecordingStream("test", recording_id="unanswered")
    recording.save(tmp_path / "s.rrd")
    view = TurbineView(recording, "t1", bare_mast(LAYOUT), rates=TO_FILE, has_structure=False)
    for number in range(MOST_AHEAD + 5):
        view.draw_estimate(estimate(mode(0.16, np.ones(8)), number=number))
    recording.disconnect()
    kept = [each.window for each in view._estimates.values()]
    assert kept == [*range(5, MOST_AHEAD + 5)]


def test_without_a_structure_the_status_is_of_modes(modes_only: Recorded) -> None:
    *_, (text,) = modes_only.column(f"{ROOT}/status", "TextDocument:text")
    assert "Modes only: 10 modes" in text
    assert "posterior" not in text
    *_, labels = modes_only.column(f"{ROOT}/indicators/text", "Points2D:labels")
    assert labels[-1] == "foundation: no structural model"
    events = [text for (text,) in modes_only.column(f"{ROOT}/events", "TextLog:text")]
    assert any(text.endswith("true stiffness known") for text in events)  # and not drawn


def test_a_small_structure_is_drawn_as_tall_as_a_tower() -> None:
    low = replace(
        LAYOUT,
        channels=tuple(replace(each, elevation=each.elevation / 50) for each in LAYOUT.channels),
    )
    drawn = outline(bare_mast(low))
    assert drawn.tower_top - drawn.mudline == pytest.approx(DRAWN_HEIGHT)
    assert drawn.scale * low.elevations.max() == pytest.approx(drawn.tower_top)


def test_changes_of_frequencies_are_relative_to_their_first_window(recorded: Recorded) -> None:
    changes = recorded.scalars(f"{ROOT}/frequencies/change/m5")[:, 0]
    absolute = recorded.scalars(f"{ROOT}/frequencies/identified/m5")[:, 0]
    assert changes == pytest.approx(100 * (absolute / absolute[0] - 1))


def test_titles_name_a_truth_only_where_one_is_drawn() -> None:
    for has_truth in (False, True):
        layout = ViewParameters("t1", (), ("1",), 50.0, has_truth=has_truth)
        (*_, foundation, _) = turbine_tabs(layout).contents
        titles = [str(each.name) for each in _views(foundation)]
        assert sum("truth green" in title for title in titles) == 5 * has_truth


def test_a_turbine_without_nodes_of_its_own_shows_those_of_the_session() -> None:
    own, other = (
        ViewParameters(name, (), ("1",), 50.0, lists_nodes=name == "t1") for name in ("t1", "t2")
    )
    _, first, second = session_blueprint([own, other], playback_speed=1.0).root_container.contents
    for tabs, words in ((first, ""), (second, ", nodes of the session")):
        (*_, health) = tabs.contents
        lost, behind, text = _views(health)
        assert [lost.origin, behind.origin] == ["/t1/health/lost", "/t1/health/behind"]
        assert str(lost.name).endswith(f"[-]{words}")
        assert text.origin == f"/{tabs.name}/health/text"


def test_heights_of_sensors_are_not_written_over_a_blade() -> None:
    hub, tip = (0.0, 0.0, 90.0), (0.0, -54.0, 58.0)
    blade = np.array([hub, tip])
    heights = [26.0, 51.0, 71.0, 93.0]
    aside = label_distance(heights, [blade])
    assert label_distance(heights, []) == SENSOR_LABELS[0] < aside
    along = np.linspace(hub, tip, 200)[:, 1:]
    labels = np.array([(-aside, height) for height in heights])
    assert np.linalg.norm(labels[:, None] - along, axis=2).min() > CLEARANCE


def _views(part: Any) -> list[Any]:
    if not isinstance(part, rrb.Container):
        return [part]
    return [view for each in part.contents for view in _views(each)]


def test_the_camera_sees_every_shape_of_modes_alone() -> None:
    """A row of twelve is farther away than one of eight, which just fits."""
    few, many = (
        shapes_view("/t1", ViewParameters("t1", (), modes, 50.0, has_structure=False), room=8)
        for modes in (("m",) * 8, ("m",) * 12)
    )
    away = [float(np.linalg.norm(np.subtract(*_camera(view)))) for view in (few, many)]
    assert away[1] / away[0] == pytest.approx(1.5, rel=0.01)


def _camera(view: Any) -> tuple[Any, Any]:
    eye = view.properties["EyeControls3D"]
    return (
        np.array(eye.position.as_arrow_array().to_pylist()[0]),
        np.array(eye.look_target.as_arrow_array().to_pylist()[0]),
    )


def test_a_run_has_as_many_colours_as_nodes() -> None:
    assert len(set(colours.LEVELS)) == len(colours.LEVELS) >= 7


def test_every_label_is_white_on_a_black_ground(recorded: Recorded) -> None:
    white = [int.from_bytes(bytes((*colours.LABEL, 255)))]
    labelled = {kind: recorded.with_column(f"{kind}:labels") for kind in ("Points2D", "Points3D")}
    assert min(map(len, labelled.values())) > 3
    for kind, entities in labelled.items():
        for entity in entities:
            drawn = [
                one
                for static in (True, False)
                for one in recorded.column(entity, f"{kind}:colors", static=static)
            ]
            assert drawn, entity
            assert all(colour == white for colour in drawn), entity
    parameters = ViewParameters("t1", (), ("1",), 50.0)
    layout = session_blueprint([parameters, replace(parameters, turbine="t2")], playback_speed=1.0)
    spatial = (rrb.Spatial2DView, rrb.Spatial3DView)
    drawings = [view for view in _views(layout.root_container) if isinstance(view, spatial)]
    assert len(drawings) > 10
    assert all(view.properties["Background"] is GROUND for view in drawings)
