"""Modes of the parked turbine: the published ones, many at once, followed and as read."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.layout import Accelerometer, LayoutError, SensorLayout
from sensors.dynamics.full_model_modes import decoupled_groups
from sensors.dynamics.modal_model import (
    ModalModel,
    ModalParameters,
    followed_by_overlap,
    full_modes,
)
from sensors.structure.assembly import assemble
from sensors.structure.components import RigidBody
from sensors.structure.foundation import FoundationSprings, TurbineError, positive_definite
from tests.sensors.structure.towers import (
    parked_model,
    parked_turbine,
    turbine_layout,
    uniform_layout,
    uniform_tower,
)

ELEVEN = [str(number) for number in range(1, 12)]
TABLE_1 = np.array(  # [foundation-updating] Table 1, frequencies of its model [Hz]
    [0.1573, 0.1587, 0.6284, 1.0898, 1.1064, 1.8298, 2.5729, 3.8598, 5.7920, 10.2769, 12.1961]
)
# Displacement shapes at 41, 80, 106, 145 m from an independent finite-element model of the same
# figures; each mode moves in one direction only
SHAPES = np.array(
    [
        [0.1804, 0.3998, 0.6030, 1.0000],
        [0.1811, 0.4010, 0.6043, 1.0000],
        [0.3481, 0.6634, 0.8566, 1.0000],
        [0.6724, 1.0000, 0.9163, 0.0174],
        [0.6827, 1.0000, 0.8937, -0.0574],
        [1.0000, 0.9184, 0.2963, -0.2554],
        [1.0000, 0.0913, -0.9615, -0.3696],
        [-0.3043, 0.7889, 1.0000, 0.0949],
        [-0.6138, -0.5584, 1.0000, 0.2909],
        [-0.6152, 1.0000, -0.4695, -0.1912],
        [0.1745, -0.5104, 1.0000, -0.2068],
    ]
)


def admissible_draws(count: int, *, seed: int, model: ModalModel | None = None) -> np.ndarray:
    """(count, 3) foundations, uniform over the admissible part of 0.25 to 4 times nominal."""
    model = model or parked_model()
    theta = np.random.default_rng(seed).uniform(0.25, 4, (4 * count, 3)) * model.nominal
    return theta[model.admissible(theta)][:count]


def mac(shapes_1: np.ndarray, shapes_2: np.ndarray) -> np.ndarray:
    """Modal assurance criterion of shapes (..., n_channels) one with one."""
    product = (shapes_1 * shapes_2).sum(axis=-1) ** 2
    return product / ((shapes_1**2).sum(axis=-1) * (shapes_2**2).sum(axis=-1))


def at_nominal(model: ModalModel) -> ModalParameters:
    return model.modal(model.nominal)


# ── the published modes ──────────────────────────────────────────────────────────────────────


def test_all_eleven_published_frequencies_are_met() -> None:
    frequencies = at_nominal(parked_model()).frequencies[0, :11]
    error = np.abs(frequencies / TABLE_1 - 1)
    assert np.all(error < 0.025)
    assert np.all(error[:2] < 0.002)


def test_the_published_sign_fits_table_1_and_the_embedded_pile_does_not() -> None:
    errors = {}
    for sign in ("published", "embedded-pile"):
        model = ModalModel(parked_turbine().with_sign(sign), turbine_layout()).subset(ELEVEN)
        relative = at_nominal(model).frequencies[0] / TABLE_1 - 1
        errors[sign] = 100 * np.sqrt(np.mean(relative**2))
    assert errors["published"] == pytest.approx(1.0, abs=0.05)
    assert errors["embedded-pile"] == pytest.approx(3.8, abs=0.1)


def test_labels_are_table_1s_then_numbered_on_by_frequency() -> None:
    model = parked_model()
    assert list(model.labels[:11]) == ELEVEN
    further = at_nominal(model).frequencies[0, 11:]
    assert list(model.labels[11:]) == [str(12 + i) for i in range(len(further))]
    assert np.all(np.diff(further) > 0)
    assert further[-1] < 12.5
    assert "".join(model.directions[:11]) == "SSFAFASS" + 7 * "FA"


def test_the_published_modes_are_those_of_which_the_tower_takes_a_part() -> None:
    share = dict(zip(parked_model().labels, parked_model().blade_energy_share, strict=True))
    expected = {"3": 0.96, "4": 0.35, "6": 0.89, "7": 0.45, "8": 0.88, "9": 0.41, "10": 0.77}
    for label, value in expected.items():
        assert share[label] == pytest.approx(value, abs=0.01)


def test_displacement_shapes_are_those_of_an_independent_model() -> None:
    model = assemble(parked_turbine())
    modes = full_modes(parked_turbine(), turbine_layout())
    rows = [model.tower_displacement(z, (1, 0, 0)) for z in (41, 80, 106, 145)]
    rows += [model.tower_displacement(z, (0, 1, 0)) for z in (41, 80, 106, 145)]
    displacement = (np.array(rows) @ modes.vectors).T
    published = at_nominal(parked_model()).frequencies[0, :11]
    for frequency, direction, expected in zip(
        published, parked_model().directions, SHAPES, strict=False
    ):
        mode = np.argmin(np.abs(modes.frequencies - frequency))
        seen = displacement[mode, :4] if direction == "FA" else displacement[mode, 4:]
        assert mac(seen, expected) > 0.99999


def test_every_mode_below_the_highest_frequency_that_moves_a_sensor_is_there() -> None:
    whole = full_modes(parked_turbine(), turbine_layout())
    share = whole.sensor_motion / whole.sensor_motion.max()
    assert len(parked_model().labels) == np.sum(share >= 0.01) == 46


def test_sensors_in_one_direction_see_no_mode_of_the_other() -> None:
    channels = turbine_layout().channels[:4]
    fore_aft = SensorLayout("fa", turbine="iea15mw", unit="tower", channels=channels)
    model = ModalModel(parked_turbine(), fore_aft)
    assert set(model.directions) == {"FA"}
    assert model.labels[:10] == ("2", "3", "5", "6", "7", "8", "9", "10", "11", "12")


# ── many foundations at once ─────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("sign", ["published", "embedded-pile"])
def test_the_reduced_model_is_the_whole_one_over_the_prior_box(sign: str) -> None:
    turbine = parked_turbine().with_sign(sign)  # type: ignore[arg-type]
    model = ModalModel(turbine, turbine_layout())
    theta = admissible_draws(5, seed=5, model=model)
    modes = model.modal(theta)
    for row, one in enumerate(theta):
        whole = full_modes(turbine, turbine_layout(), one, highest_frequency=25.0)
        nearest = np.abs(whole.frequencies - modes.frequencies[row][:, None])
        similar = mac(modes.shapes[row][:, None], whole.shapes[None])
        nearest[similar < 0.9] = np.inf
        match = nearest.argmin(axis=1)
        assert modes.frequencies[row] == pytest.approx(whole.frequencies[match], rel=2e-6)
        assert np.abs(modes.shapes[row]) == pytest.approx(np.abs(whole.shapes[match]), abs=2e-3)
        assert len(set(match.tolist())) == len(model.labels)  # no mode twice


def test_batches_are_solved_as_one_by_one() -> None:
    theta = admissible_draws(70, seed=6)  # more than are solved together
    together = parked_model().modal(theta)
    for row in (0, 33, 69):
        alone = parked_model().modal(theta[row])
        assert alone.frequencies[0] == pytest.approx(together.frequencies[row], rel=1e-9)
        assert alone.shapes[0] == pytest.approx(together.shapes[row], abs=1e-6)


def test_shapes_are_normalised_to_a_largest_component_of_exactly_one() -> None:
    shapes = parked_model().modal(admissible_draws(20, seed=7)).shapes
    assert np.all(np.abs(shapes) <= 1.0)
    assert np.all(shapes.max(axis=-1) == 1.0)


def test_fore_aft_modes_are_not_read_side_side() -> None:
    shapes = parked_model().modal(admissible_draws(3, seed=8)).shapes
    for number, direction in enumerate(parked_model().directions):
        other = slice(4, 8) if direction == "FA" else slice(0, 4)
        assert not shapes[:, number, other].any()


def test_foundations_that_cannot_be_hold_nan_and_leave_the_others_alone() -> None:
    nominal = parked_model().nominal
    theta = nominal * np.array([[1, 1, 1], [0.25, 0.25, 4], [-1, 1, 1], [1, np.nan, 1], [2, 2, 2]])
    modes = parked_model().modal(theta)
    assert modes.admissible.tolist() == [True, False, False, False, True]
    assert np.isnan(modes.frequencies[1:4]).all()
    assert np.isnan(modes.shapes[1:4]).all()
    assert np.isfinite(modes.frequencies[[0, 4]]).all()


def test_a_batch_without_any_admissible_foundation_is_all_nan() -> None:
    modes = parked_model().modal(-parked_model().nominal)
    assert not modes.admissible.any()
    assert np.isnan(modes.frequencies).all()


def test_springs_that_gravity_overcomes_are_not_admissible_though_positive_definite() -> None:
    """At the edge of positive definiteness the whole tips over: 0.1 % of the prior box."""
    nominal = parked_model().nominal
    k11, k22, _ = nominal
    edge = np.sqrt(k11 * k22) / nominal[2]
    theta = nominal * np.stack([np.ones(200), np.ones(200), np.linspace(0.99, 1.0, 200) * edge], 1)
    admissible = parked_model().admissible(theta)
    lowest = []
    for one in theta[[150, -2]]:
        stiffness = assemble(parked_turbine(), stiffness=one).stiffness
        lowest.append(np.linalg.eigvalsh(stiffness)[0] > 0)
    assert positive_definite(theta[:-1]).all()
    assert admissible[0]
    assert not admissible[-2]
    assert lowest == admissible[[150, -2]].tolist()


def test_a_subset_gives_the_same_modes_in_its_own_order() -> None:
    theta = admissible_draws(10, seed=9)
    every, some = parked_model().modal(theta), parked_model().subset(["9", "2", "20"]).modal(theta)
    places = [parked_model().labels.index(label) for label in ("9", "2", "20")]
    assert some.labels == ("9", "2", "20")
    assert some.frequencies == pytest.approx(every.frequencies[:, places], rel=1e-5)
    assert some.shapes == pytest.approx(every.shapes[:, places], abs=5e-3)


def test_a_subset_of_modes_that_are_not_there_is_refused() -> None:
    with pytest.raises(KeyError, match="no mode '99'"):
        parked_model().subset(["1", "99"])


def test_damping_is_attached_where_asked() -> None:
    model = parked_model()
    assert at_nominal(model).damping_ratios is None
    attached = model.modal(model.nominal, damping=0.007).damping_ratios
    assert attached is not None
    assert np.all(attached == 0.007)


def test_stiffer_springs_raise_every_frequency_or_leave_it() -> None:
    model = parked_model().subset(["1", "2", "4", "5"])
    nominal = model.nominal
    softer = model.modal(nominal).frequencies
    for factor in ([1.2, 1, 1], [1, 1.2, 1], [1.1, 1.1, 1.1]):
        assert np.all(model.modal(nominal * factor).frequencies > softer)


# ── following ────────────────────────────────────────────────────────────────────────────────


def test_modes_that_cross_are_followed_by_their_shape_not_by_their_order() -> None:
    """Two oscillators, one stiffened until it passes the other with a slight coupling."""
    stiffening = np.linspace(0.0, 1.0, 41)
    stiffness = np.zeros((41, 2, 2))
    stiffness[:, 0, 0], stiffness[:, 1, 1] = 1.0 + stiffening, 1.5
    stiffness[:, 0, 1] = stiffness[:, 1, 0] = 0.01
    squares, vectors = np.linalg.eigh(stiffness)
    start = vectors[0]
    overlap = np.einsum("ir,nim->nrm", start, vectors) ** 2
    places = followed_by_overlap(overlap)
    followed = np.take_along_axis(squares, places, axis=1)
    assert places[0].tolist() == [0, 1]
    assert places[-1].tolist() == [1, 0]
    assert np.abs(followed[:, 0] - (1.0 + stiffening)).max() < 0.02
    assert np.abs(followed[:, 1] - 1.5).max() < 0.02


def test_no_mode_follows_two_references() -> None:
    overlap = np.array([[[0.6, 0.4, 0.0], [0.55, 0.1, 0.2]]])  # both like mode 0 best
    assert followed_by_overlap(overlap).tolist() == [[1, 0]]  # .4 + .55 against .6 + .2


def test_labels_keep_their_modes_where_the_order_of_frequencies_changes() -> None:
    model = parked_model()
    start, stiff = at_nominal(model), model.modal(model.nominal * 3.0)
    order = np.argsort(start.frequencies[0])
    swapped = np.flatnonzero(np.diff(stiff.frequencies[0][order]) < 0)
    assert len(swapped) > 0
    for place in swapped:
        below, above = order[place], order[place + 1]
        kept = mac(start.shapes[0][[below, above]], stiff.shapes[0][[below, above]])
        taken = mac(start.shapes[0][[below, above]], stiff.shapes[0][[above, below]])
        assert kept.sum() > taken.sum()


def test_following_from_another_foundation_gives_the_same_modes_there() -> None:
    model = parked_model()
    elsewhere = model.nominal * [0.7, 0.75, 0.7]
    moved = model.following(elsewhere)
    assert moved.labels == model.labels
    assert moved.theta_reference == pytest.approx(elsewhere)
    assert np.array_equal(moved.nominal, model.nominal)
    here, there = model.modal(elsewhere), moved.modal(elsewhere)
    assert there.frequencies == pytest.approx(here.frequencies, rel=1e-6)
    assert there.shapes == pytest.approx(here.shapes, abs=1e-3)


def test_following_to_a_foundation_that_gives_way_is_refused() -> None:
    model = parked_model()
    with pytest.raises(TurbineError, match="falls over on k11 = "):
        model.following(model.nominal * [0.25, 0.25, 4.0])


# ── what an accelerometer reads ──────────────────────────────────────────────────────────────


def test_gravity_adds_a_tenth_at_the_top_and_a_quarter_low_down_to_the_first_mode() -> None:
    """φ + g ψ / ω²: 11 % more at 145 m and 25 % more at 41 m, hardly anything above 1 Hz."""
    model = assemble(parked_turbine())
    modes = full_modes(parked_turbine(), turbine_layout())
    for mode, top, low in ((1, 0.11, 0.25), (9, 0.0, 0.0)):  # modes 2 and 5 of Table 1
        added = []
        for z in (145.0, 41.0):
            u = model.tower_displacement(z, (1, 0, 0)) @ modes.vectors[:, mode]
            slope = model.tower_slope(z, (1, 0, 0)) @ modes.vectors[:, mode]
            added.append(9.81 * slope / (2 * np.pi * modes.frequencies[mode]) ** 2 / u)
        if mode == 1:
            assert added == pytest.approx([top, low], abs=0.006)
            expected = 0.1811 * (1 + added[1]) / (1 + added[0])
            assert at_nominal(parked_model()).shapes[0, 1, 0] == pytest.approx(expected, abs=2e-4)
        else:
            assert abs(added[1]) < 0.01


def test_an_ac_coupled_layout_of_one_kind_reads_the_shapes_of_a_dc_coupled_one() -> None:
    """One pole, the same in every channel, scales and turns all of them alike."""
    ac = ModalModel(parked_turbine(), turbine_layout(coupling="ac", corner_frequency=0.1))
    assert at_nominal(ac).shapes == pytest.approx(at_nominal(parked_model()).shapes, abs=1e-12)


def test_one_ac_coupled_channel_reads_less_of_the_slow_modes() -> None:
    corner = 0.1
    channels = list(turbine_layout().channels)
    channels[0] = Accelerometer(
        "z41-fa", 41.0, (1.0, 0.0, 0.0), coupling="ac", corner_frequency=corner
    )
    mixed = SensorLayout("mixed", turbine="iea15mw", unit="tower", channels=tuple(channels))
    dc, ac = at_nominal(parked_model()), at_nominal(ModalModel(parked_turbine(), mixed))
    frequency = dc.frequencies[0, 1]
    in_phase = 1 / (1 + (corner / frequency) ** 2)  # real part of 1 / (1 − i f_c / f)
    assert ac.shapes[0, 1, 0] == pytest.approx(in_phase * dc.shapes[0, 1, 0], rel=1e-6)
    assert ac.shapes[0, 1, 1:] == pytest.approx(dc.shapes[0, 1, 1:])
    assert ac.shapes[0, 10] == pytest.approx(dc.shapes[0, 10], abs=1e-3)


def test_an_oblique_axis_reads_both_directions() -> None:
    oblique = SensorLayout(
        "oblique",
        turbine="iea15mw",
        unit="tower",
        channels=(
            Accelerometer("a", 145.0, (0.6, 0.8, 0.0)),
            Accelerometer("b", 145.0, (0.8, -0.6, 0.0)),
        ),
    )
    first, second = at_nominal(ModalModel(parked_turbine(), oblique)).shapes[0, :2]
    assert first == pytest.approx([1.0, -0.75])  # side-side
    assert second == pytest.approx([0.75, 1.0])  # fore-aft


def test_a_sensor_off_the_tower_is_named() -> None:
    layout = turbine_layout()
    channels = (*layout.channels, Accelerometer("mast", 160.0, (1.0, 0.0, 0.0)))
    with pytest.raises(LayoutError, match="channel mast: elevation 160 m is not on the tower"):
        ModalModel(parked_turbine(), replace(layout, channels=channels))


# ── other structures ─────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize(
    "rotor", [{"azimuth": 25.0}, {"number": 2}, {"number": 4}, {"modes_per_element": 0}]
)
def test_other_rotors_separate_into_fore_aft_and_side_side(rotor: dict[str, float]) -> None:
    assert parked_turbine().blades is not None
    blades = replace(parked_turbine().blades, **rotor)
    turbine = replace(parked_turbine(), blades=blades, reference_modes=())
    model = ModalModel(turbine, turbine_layout())
    theta = model.nominal * [1.4, 0.9, 0.8]
    whole = full_modes(turbine, turbine_layout(), theta, highest_frequency=20.0)
    distance = np.abs(whole.frequencies - model.modal(theta).frequencies[0][:, None])
    assert np.all(distance.min(axis=1) < 1e-5 * model.modal(theta).frequencies[0])


def test_the_azimuth_of_a_three_bladed_rotor_does_not_matter() -> None:
    assert parked_turbine().blades is not None
    turned = replace(parked_turbine(), blades=replace(parked_turbine().blades, azimuth=37.0))
    model = ModalModel(turned, turbine_layout())
    assert at_nominal(model).frequencies == pytest.approx(
        at_nominal(parked_model()).frequencies, rel=1e-8
    )


def test_half_feathered_blades_couple_the_directions_and_are_solved_all_the_same() -> None:
    assert parked_turbine().blades is not None
    blades = replace(parked_turbine().blades, pitch=60.0)
    turbine = replace(parked_turbine(), blades=blades, reference_modes=())
    assert len(decoupled_groups(assemble(turbine))) == 1
    model = ModalModel(turbine, turbine_layout())
    theta = model.nominal * [1.4, 0.9, 0.8]
    modes = model.modal(theta)
    whole = full_modes(turbine, turbine_layout(), theta, highest_frequency=20.0)
    distance = np.abs(whole.frequencies - modes.frequencies[0][:, None])
    assert np.all(distance.min(axis=1) < 1e-5 * modes.frequencies[0])
    assert np.abs(modes.shapes[0, :, :4]).max(axis=1).min() > 0  # nothing is purely side-side


def test_a_plain_tower_of_ones_own_needs_neither_rotor_nor_water_nor_table() -> None:
    springs = FoundationSprings(k11=2e9, k22=5e11, k12=1e10)
    tower = uniform_tower(foundation=springs, gravity=9.81, top=RigidBody("top", mass=2e5))
    model = ModalModel(tower, uniform_layout(), highest_frequency=20.0)
    theta = model.nominal * np.array([[1, 1, 1], [1.5, 0.6, 0.8]])
    modes = model.modal(theta)
    assert model.labels[0] == "1"
    for row, one in enumerate(theta):
        whole = full_modes(tower, uniform_layout(), one, highest_frequency=30.0)
        distance = np.abs(whole.frequencies - modes.frequencies[row][:, None]).min(axis=1)
        assert np.all(distance < 1e-6 * modes.frequencies[row])


def test_a_single_rigid_tube_has_its_two_swings_in_each_direction() -> None:
    springs = FoundationSprings(k11=2e9, k22=5e11, k12=1e10)
    tower = uniform_tower(elements=1, foundation=springs, youngs_modulus=210e13)
    model = ModalModel(tower, uniform_layout(), highest_frequency=30.0)
    frequencies = model.modal(model.nominal * [2.0, 0.7, 0.9]).frequencies[0]
    whole = full_modes(
        tower, uniform_layout(), model.nominal * [2.0, 0.7, 0.9], highest_frequency=60
    )
    assert len(frequencies) == 4
    assert np.sort(frequencies) == pytest.approx(whole.frequencies[:4], rel=1e-6)


def test_a_tower_that_cannot_stand_on_its_own_foundation_is_refused() -> None:
    weak = FoundationSprings(k11=1e6, k22=1e6, k12=0.0)
    tower = uniform_tower(foundation=weak, gravity=9.81)
    with pytest.raises(TurbineError, match=r"uniform falls over on k11 = 1e\+06 N/m"):
        ModalModel(tower, uniform_layout())


def test_a_published_mode_that_the_model_does_not_reach_is_named() -> None:
    with pytest.raises(TurbineError, match=r"reference mode '3' \(FA, 0.6284 Hz\)"):
        ModalModel(parked_turbine(), turbine_layout(), highest_frequency=0.3)
