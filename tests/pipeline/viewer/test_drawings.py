"""What is drawn: tower, shapes, swing, corner plot, as plain figures."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import welch

from pipeline.messages import FoundationTruth, StabilisationDiagram
from pipeline.viewer.pictures.corner import PITCH, Axis, corner_plot
from pipeline.viewer.pictures.mac_matrix import LABEL_PITCH, mac_matrix, shade_values
from pipeline.viewer.pictures.pile import LOAD, TALL, mudline_response, pile_picture
from pipeline.viewer.pictures.scene import (
    deflection,
    outline,
    scale_onto,
    swing_frames,
    tube_mesh,
)
from pipeline.viewer.pictures.spectrum import (
    DECADES,
    SEGMENT,
    FrequencyAxis,
    RecentSamples,
    power_spectral_densities,
    spectrum_picture,
)
from pipeline.viewer.pictures.stabilisation import stabilisation_picture
from pipeline.viewer.tabs.signals import signals
from pipeline.viewer.view_parameters import ViewParameters
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.structure.foundation import SPRING_SIGNS, SpringSign, spring_matrix
from tests.pipeline.viewer.session import (
    DESCRIPTION,
    LAYOUT,
    TRUE_RATIOS,
    TURBINE,
    acceleration_block,
    foundation_posterior,
    modal_estimate,
    stabilisation_diagram,
)

MINUTE = 60 * NANOSECONDS


def test_tubes_have_their_diameters_at_their_elevations():
    mesh = tube_mesh(DESCRIPTION.tubes)
    radii = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    for tube in DESCRIPTION.tubes:
        at_bottom = np.isclose(mesh.vertices[:, 2], tube.bottom)
        assert np.isclose(radii[at_bottom], tube.diameter / 2).any()


def test_faces_of_the_tubes_look_outwards():
    mesh = tube_mesh(DESCRIPTION.tubes[:1])
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) * [1.0, 1.0, 0.0]
    assert (np.einsum("ij,ij->i", normals, outwards) > 0).all()


def test_blades_are_as_long_as_described_and_one_points_up():
    blades = outline(DESCRIPTION).blades
    described = DESCRIPTION.blades
    assert described is not None
    lengths = [np.linalg.norm(tip - root) for root, tip in blades]
    assert lengths == pytest.approx([described.elements[-1].outer] * described.number)
    assert max(tip[2] for _, tip in blades) > DESCRIPTION.tower_top + 100.0


def test_rotor_is_upwind_of_the_tower():
    for root, _ in outline(DESCRIPTION).blades:
        assert root[0] < 0.0


def test_a_skew_accelerometer_moves_the_picture_along_its_own_direction():
    skew = SensorLayout(
        "l",
        turbine="t",
        unit="u",
        channels=(
            Accelerometer("a", 50.0, (0.6, 0.8, 0.0)),
            Accelerometer("b", 50.0, (-0.8, 0.6, 0.0)),
        ),
    )
    moved = deflection(skew, ("a", "b"), np.array([0.6, -0.8]))
    assert moved.displacements == pytest.approx(np.array([[1.0, 0.0, 0.0]]))
    assert moved.direction == "FA"


def test_two_sensors_along_one_axis_at_one_height_are_drawn_at_their_mean():
    twice = SensorLayout(
        "t1", "u", "twice", tuple(Accelerometer(name, 50.0, (1.0, 0.0, 0.0)) for name in "ab")
    )
    moved = deflection(twice, ("a", "b"), np.array([0.9, 1.1]))
    assert moved.displacements == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


def test_a_shape_on_part_of_the_channels_is_drawn_where_these_sit():
    part = deflection(LAYOUT, ("z145-ss", "z41-ss"), np.array([1.0, 0.2]))
    assert list(part.elevations) == [41.0, 145.0]
    assert list(part.displacements[:, 1]) == [0.2, 1.0]
    assert part.direction == "SS"


def test_shapes_of_opposite_sign_are_laid_on_each_other():
    shape = np.array([0.2, 0.6, 1.0])
    assert scale_onto(-3.0 * shape, shape) == pytest.approx(shape)


def test_consecutive_stretches_of_frames_are_the_frames_of_the_whole():
    origin = 7 * MINUTE
    whole = swing_frames(0, 20 * MINUTE, full_swing_ns=origin, period=60.0)
    cuts = [0, 123_456_789, 5 * MINUTE, 5 * MINUTE + 1, 20 * MINUTE]
    parts = [
        swing_frames(start, end, full_swing_ns=origin, period=60.0) for start, end in pairwise(cuts)
    ]
    assert list(np.concatenate([part.times_ns for part in parts])) == list(whole.times_ns)
    assert whole.factors[whole.times_ns == origin] == pytest.approx(1.0)
    assert (whole.times_ns >= 0).all()
    assert (whole.times_ns < 20 * MINUTE).all()


def test_corner_plot_keeps_pairs_below_and_marginals_on_the_diagonal():
    rng = np.random.default_rng(3)
    ratios = rng.normal(1.0, 0.02, size=(500, 3))
    plot = corner_plot(ratios, ("a", "b", "c"), truth=np.array([1.0, 1.0, 1.0]))
    column, row = np.floor(plot.draws / PITCH).astype(int).T
    assert set(zip(row, column, strict=True)) == {(1, 0), (2, 0), (2, 1)}
    assert len(plot.histograms) == 3
    assert len(plot.truth) == 3 + 2 * 3  # a line on each marginal, a cross on each pair


def test_a_flat_prior_is_as_high_as_its_density_on_the_scale_of_the_marginal():
    """A posterior that is uniform over a quarter of the prior has four times its density."""
    ratios = np.random.default_rng(3).uniform(1.0, 1.5, size=(20_000, 2))
    learned = np.array([0.75, 0.75])
    plot = corner_plot(ratios, ("a", "b"), contraction=learned)
    assert len(plot.priors) == 2
    for i, line in enumerate(plot.priors):
        foot = i * PITCH + 1.0
        highest = foot - plot.histograms[i][:, 1].min()
        np.testing.assert_allclose((foot - line[:, 1]) / highest, 0.25, rtol=0.1)  # bins scatter
    assert corner_plot(ratios, ("a", "b"), contraction=learned, flat_prior=False).priors == ()


def test_a_posterior_that_learned_nothing_has_labels_that_can_be_read():
    ratios = np.random.default_rng(3).lognormal(0.0, 1.0, size=(2000, 2))
    plot = corner_plot(ratios, ("a", "b"), contraction=np.array([-0.09, 0.9]))
    labels = [text.text for text in plot.texts]
    assert "109 % of prior width" in labels
    assert "10 % of prior width" in labels
    assert not any(label.startswith("-") for label in labels)  # a ratio is positive


def test_a_truth_far_from_the_posterior_is_inside_the_picture():
    rng = np.random.default_rng(3)
    ratios = rng.normal(1.0, 0.01, size=(500, 2))
    plot = corner_plot(ratios, ("a", "b"), truth=np.array([1.5, 0.5]))
    for line in plot.truth:
        assert line.min() >= -1e-9
        assert line.max() <= PITCH + 1.0 + 1e-9


@pytest.mark.parametrize("width", [1e-4, 0.003, 0.02, 0.5, 3.0])
def test_axes_have_two_to_five_ticks_inside(width: float):
    axis = Axis(1.0 - width / 3, 1.0 + 2 * width / 3)
    assert 1 <= len(axis.ticks) <= 5
    assert ((axis.ticks > axis.low) & (axis.ticks < axis.high)).all()


def test_a_swinging_mode_has_its_peak_at_its_frequency_in_the_spectrum():
    rate, frequency = 40.0, 1.8
    t = np.arange(0, 600, 1 / rate)
    samples = np.zeros((len(t), len(LAYOUT.channels)))
    samples[:, 0] = np.sin(2 * np.pi * frequency * t)
    samples[:, 1:] = 1e-3 * np.random.default_rng(3).standard_normal((len(t), 7))
    picture = spectrum_picture(samples, rate, [LAYOUT], [frequency], duration=600.0)
    highest = picture.spectra[0][np.argmin(picture.spectra[0][:, 1])]
    assert abs(highest[0] - picture.modes[0][0, 0]) < 0.02
    assert len(picture.spectra) == len(LAYOUT.channels)


def test_a_direction_that_no_channel_measures_has_no_panel():
    fore_aft = replace(LAYOUT, channels=LAYOUT.channels[:4])
    samples = np.random.default_rng(4).standard_normal((4000, 4))
    picture = spectrum_picture(samples, 40.0, [fore_aft], [1.8], duration=100.0)
    assert len(picture.modes) == 1
    assert not any("side-side" in text.text for text in picture.texts)


def test_every_channel_is_in_a_plot_and_a_spectrum_also_an_upright_or_a_skew_one():
    directions = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.6, 0.28**0.5)]
    channels = tuple(Accelerometer(f"c{n}", 9.0 + n, each) for n, each in enumerate(directions))
    layout = replace(LAYOUT, channels=channels)
    samples = np.random.default_rng(4).standard_normal((4000, 4))
    picture = spectrum_picture(samples, 40.0, [layout], [], duration=100.0)
    assert sorted(picture.levels) == [0, 1, 2, 3]
    assert len(picture.frames) == 3
    assert any("vertical" in text.text for text in picture.texts)
    plots, spectra = signals("/t", ViewParameters("t", (layout,), (), 50.0)).contents
    shown = [
        each.visible_series.as_arrow_array().to_pylist()
        for plot in plots.contents
        for each in plot.visualizer_overrides.values()
    ]
    assert np.sum(shown, axis=0).tolist() == [1, 1, 1, 1]
    foot = picture.frames[-1][:, 1].max()
    (bounds,) = spectra.properties["VisualBounds2D"].range.as_arrow_array().to_pylist()
    assert bounds["y_range"][1] > foot


def test_a_spectrum_of_a_part_of_its_window_says_so():
    samples = np.random.default_rng(4).standard_normal((4000, 8))
    for duration, words in ((100.0, "Hz]"), (200.0, "Hz]; 1.67 of 3.33 min")):
        picture = spectrum_picture(samples, 40.0, [LAYOUT], [], duration=duration)
        (title,) = (each.text for each in picture.texts if "fore-aft" in each.text)
        assert title.endswith(words)


@pytest.mark.parametrize("seconds", [600.0, 37.5])
def test_spectra_in_single_precision_equal_welchs_over_the_drawn_decades(seconds: float):
    """The same as SciPy's in double precision, six decades down; a record shorter than a segment
    is one segment."""
    rate, rng = 40.0, np.random.default_rng(8)
    t = np.arange(round(seconds * rate)) / rate
    tones = 3.0 * np.sin(2 * np.pi * 0.158 * t) + 0.01 * np.sin(2 * np.pi * 7.3 * t)
    samples = 1.5 + tones[:, None] + 0.02 * rng.standard_normal((len(t), 2))
    f, densities = power_spectral_densities(samples.astype(np.float32), rate)
    segment = min(len(t), round(SEGMENT * rate))
    expected_f, expected = welch(samples, rate, nperseg=segment, axis=0)
    np.testing.assert_allclose(f, expected_f)
    shown = expected > expected.max() * 10.0**-DECADES
    np.testing.assert_allclose(densities[shown], expected[shown], rtol=2e-3)


def test_samples_of_a_window_are_those_of_its_blocks_and_old_ones_are_let_go():
    recent = RecentSamples()
    rng = np.random.default_rng(8)
    blocks = [acceleration_block(sequence, 600, rng) for sequence in range(12)]
    for block in blocks:
        recent.push(block)
    found = recent.between(blocks[10].start_ns, blocks[11].end_ns)
    assert found is not None
    samples, rate = found
    np.testing.assert_allclose(samples, np.concatenate([blocks[10].samples, blocks[11].samples]))
    assert rate == blocks[10].sampling_rate
    assert recent.between(blocks[0].start_ns, blocks[0].end_ns) is None


def test_a_window_has_the_rate_of_its_own_samples():
    recent, rng = RecentSamples(), np.random.default_rng(8)
    first, second, third = (acceleration_block(sequence, 600, rng) for sequence in range(3))
    faster = replace(second, sampling_rate=2 * first.sampling_rate)
    for each in (first, faster, third):
        recent.push(each)
    found = [recent.between(each.start_ns, each.end_ns) for each in (first, second)]
    assert [each and each[1] for each in found] == [first.sampling_rate, 2 * first.sampling_rate]
    assert recent.between(first.start_ns, second.end_ns) is None


def test_mac_matrix_is_bright_on_its_diagonal_and_in_the_order_of_frequency():
    rng = np.random.default_rng(8)
    estimate = modal_estimate(0, rng)
    matrix = mac_matrix(estimate, foundation_posterior(estimate, 1, rng))
    assert matrix is not None
    assert np.all(np.diag(matrix.values) > 0.98)
    expected = np.array(
        [[np.dot(a.shape, b.shape) for b in estimate.modes] for a in estimate.modes]
    )
    norms = np.array([np.linalg.norm(mode.shape) for mode in estimate.modes])
    np.testing.assert_allclose(matrix.values, (expected / np.outer(norms, norms)) ** 2, atol=0.06)


@pytest.mark.parametrize("copies", [1, 4])
def test_labels_of_a_mac_matrix_do_not_cover_each_other(copies: int):
    """Forty modes have squares smaller than their labels: some then go without."""
    rng = np.random.default_rng(8)
    estimate = modal_estimate(0, rng)
    posterior = foundation_posterior(estimate, 1, rng)
    crowded = replace(estimate, modes=estimate.modes * copies)
    matrix = mac_matrix(crowded, posterior)
    assert matrix is not None
    heights = [text.position[1] for text in matrix.texts if text.position[0] < 0.0]
    assert np.diff(heights).min() >= LABEL_PITCH
    assert len(heights) == (len(crowded.modes) if copies == 1 else len(crowded.modes) // 3 + 1)


def test_shades_run_from_dark_to_bright():
    brightness = shade_values(np.linspace(0, 1, 9)).astype(float) @ [0.3, 0.6, 0.1]
    assert np.all(np.diff(brightness) > 0)


def test_an_octave_is_as_wide_anywhere_on_the_frequency_axis():
    axis = FrequencyAxis(0.1, 25.6)
    octaves = axis.position(0.1 * 2.0 ** np.arange(9))
    assert np.diff(octaves) == pytest.approx(2.6 / 8)
    assert axis.ticks == [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0]


def test_a_mode_is_a_column_of_poles_under_its_hair_and_higher_orders_stand_higher():
    rng = np.random.default_rng(8)
    estimate = modal_estimate(0, rng)
    diagram = stabilisation_diagram(estimate, rng)
    picture = stabilisation_picture(diagram, [mode.frequency for mode in estimate.modes])
    x, y = picture.poles.T
    for mode, vertical_line in zip(estimate.modes, picture.modes, strict=True):
        near = np.abs(diagram.frequencies - mode.frequency) < 5 * mode.frequency_std
        assert x[near] == pytest.approx(vertical_line[0, 0], abs=0.02)
    assert (np.diff(y[np.argsort(diagram.orders, kind="stable")]) <= 0).all()
    left, right = np.array(picture.stds)[:, :, 0].T
    assert ((left < x) & (x < right)).all()


def test_a_window_without_poles_is_an_empty_diagram():
    estimate = modal_estimate(0, np.random.default_rng(8))
    nothing = np.empty(0, np.float32)
    span = ("t", 0, estimate.start_ns, estimate.end_ns)
    picture = stabilisation_picture(StabilisationDiagram(*span, *[nothing] * 5), [])
    assert len(picture.poles) == len(picture.stds) == 0


@pytest.mark.parametrize("sign", SPRING_SIGNS)
def test_a_tower_leans_as_its_springs_let_it(sign: SpringSign):
    """The work of the load is twice the springs' energy, and softer springs give way further."""
    theta, height = DESCRIPTION.nominal, 175.0
    u, psi = mudline_response(theta, height, sign)
    energy = 0.5 * np.array([u, psi]) @ spring_matrix(theta, sign) @ np.array([u, psi])
    assert 0.5 * LOAD * (u + height * psi) == pytest.approx(energy)
    assert mudline_response(0.9 * theta, height, sign) == pytest.approx(np.array([u, psi]) / 0.9)
    assert (u > 0) == (sign == "embedded-pile")


@pytest.mark.parametrize("all_singular", [False, True])
def test_draws_of_springs_that_carry_no_load_are_left_out(all_singular: bool):
    rng = np.random.default_rng(8)
    posterior = foundation_posterior(modal_estimate(0, rng), 1, rng)
    draws = posterior.draws.copy()
    draws[: None if all_singular else 3, :3] = [2.0**20, 2.0**30, 2.0**25]  # k11·k22 = k12²
    truth = FoundationTruth(TURBINE, 0, 2.0**20, 2.0**30, 2.0**25)
    picture = pile_picture(replace(posterior, draws=draws), DESCRIPTION, truth)
    assert len(picture.posterior) == (0 if all_singular else 3)
    assert np.isfinite(np.array(picture.posterior)).all()
    assert len(picture.truth) == 0


def test_the_truth_leans_within_the_posterior_and_less_than_nominal_where_it_is_stiffer():
    truth = FoundationTruth(TURBINE, 0, *map(float, TRUE_RATIOS * DESCRIPTION.nominal))
    rng = np.random.default_rng(8)
    posterior = foundation_posterior(modal_estimate(0, rng), 1, rng)
    picture = pile_picture(posterior, DESCRIPTION, truth)
    low, _, high = (line[1, 0] for line in picture.posterior)
    ((_, (true, top)),) = picture.truth
    assert low < true < high < picture.nominal[1, 0]
    assert top == -TALL
    assert len(pile_picture(posterior, DESCRIPTION).truth) == 0
    text_labels = " ".join(text.text for text in picture.texts)
    assert all(unit in text_labels for unit in ("N/m", "N·m/rad", "N/rad", "mm", "mrad", "MN"))
