"""Which of several faults of sensors is named."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.sensors import faults
from pipeline.updating.structural.sensors.faults import SensorFault


@dataclass(frozen=True)
class Pairing:
    paired_share: float


@dataclass(frozen=True)
class Comparison:
    pairing: Pairing
    unlike_shapes: int = 0


@dataclass(frozen=True)
class Fit:
    sensors: Any


@dataclass(frozen=True)
class NoFigures:
    figures: tuple[()] = ()


def peak(cost: float, degrees: int, share: float, unlike: int = 0) -> JointPeak:
    comparison: Any = Comparison(Pairing(share), unlike)
    return JointPeak(np.zeros(3), comparison, cost, degrees)


def fault(name: str) -> SensorFault:
    fit: Any = Fit(NoFigures())
    return SensorFault(name, name, fit, (0,), (1.0,))


def best(
    ends: dict[str, JointPeak], without: JointPeak, monkeypatch: pytest.MonkeyPatch
) -> str | None:
    monkeypatch.setattr(faults, "_fitted", lambda each, *_: ends[each.name])
    evidence: Any = None
    found = faults._best_of([fault(name) for name in ends], evidence, without)
    return None if found is None else found[0].name


def test_a_shape_that_is_left_out_does_not_count_as_one_that_fits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All sensors turned by 30°: without the fault frequencies alone are compared, and fit."""
    ends = {"turned": peak(245.0, 241, 1.0)}
    assert best(ends, peak(32.0, 31, 1.0), monkeypatch) is None
    assert best(ends, peak(32.0, 31, 1.0, unlike=30), monkeypatch) == "turned"


def test_a_fault_that_gives_all_modes_their_partners_is_better_than_a_cheaper_one_that_leaves_some(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tower whose sensors at 41 and 145 m are swapped: an exchange of two of the four channels
    explains fewer modes, whose costs are then missing from its own."""
    ends = {
        "swapped 41 145": peak(267.5, 241, 1.0),
        "exchanged z41-fa z145-fa": peak(222.6, 126, 0.74),
    }
    assert best(ends, peak(297.7, 33, 0.53), monkeypatch) == "swapped 41 145"


def test_chance_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    assert best({"gain z41-fa": peak(230.0, 240, 1.0)}, peak(240.0, 240, 1.0), monkeypatch) is None


def test_a_fault_that_loses_partners_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert (
        best({"flipped z41-fa": peak(90.0, 180, 0.8)}, peak(240.0, 240, 1.0), monkeypatch) is None
    )


@pytest.mark.parametrize(
    ("cost", "paired", "expected"), [(1.51, 1.0, True), (1.0, 0.84, True), (1.5, 0.85, False)]
)
def test_faults_are_looked_for_where_cost_or_pairs_call_for_it(
    cost: float, paired: float, expected: bool
) -> None:
    """No shape is compared here."""
    comparison = SimpleNamespace(
        is_frequency=np.ones(3, dtype=bool),
        pairing=SimpleNamespace(paired_share=paired),
        unlike_share=0.0,
    )
    peak = SimpleNamespace(relative_cost=cost, comparison=comparison)
    assert faults.suspicious(None, peak) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("error", "figure", "expected"),
    [(1.1, 0.0, False), (1.2, 0.0, True), (0.0, 3.0, False), (0.0, -3.1, True), (0.0, 3.1, True)],
)
def test_faults_are_looked_for_where_shapes_or_a_sensors_figure_call_for_it(
    error: float, figure: float, expected: bool
) -> None:
    """χ² per shape component 1.35, a figure three standard deviations from its prior."""
    comparison = SimpleNamespace(
        is_frequency=np.array([True, False, False]),
        pairing=SimpleNamespace(paired_share=1.0),
        errors=np.array([9.0, error, error]),
        groups=np.zeros(3, dtype=int),
        unlike_share=0.0,
    )
    fit = SimpleNamespace(
        variances=lambda found, sigma: np.ones(3),
        coordinates=SimpleNamespace(sensors=lambda u: np.array([0.0, figure])),
    )
    peak = SimpleNamespace(relative_cost=1.0, comparison=comparison, u=None)
    assert faults.suspicious(fit, peak) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(("n_modes", "expected"), [(1, False), (3, True)])
def test_one_mode_whose_shape_is_far_off_is_no_fault_of_a_sensor(
    n_modes: int, expected: bool
) -> None:
    """Twelve modes of seven components; a mixture of two modes shows in one, a sensor in all."""
    groups = np.repeat(np.arange(12), 7)
    comparison = SimpleNamespace(
        is_frequency=np.zeros(groups.size, dtype=bool),
        pairing=SimpleNamespace(paired_share=1.0),
        errors=np.where(groups < n_modes, 20.0, 0.9),
        groups=groups,
        unlike_share=0.0,
    )
    fit = SimpleNamespace(
        variances=lambda found, sigma: np.ones(groups.size),
        coordinates=SimpleNamespace(sensors=lambda u: np.zeros(1)),
    )
    peak = SimpleNamespace(relative_cost=1.0, comparison=comparison, u=None)
    assert faults.suspicious(fit, peak) is expected  # type: ignore[arg-type]


@pytest.mark.parametrize(("unlike", "expected"), [(0.25, False), (0.26, True)])
def test_faults_are_looked_for_where_shapes_are_not_those_of_the_partners(
    unlike: float, expected: bool
) -> None:
    """Frequencies alone are compared then, and fit."""
    comparison = SimpleNamespace(
        is_frequency=np.ones(3, dtype=bool),
        pairing=SimpleNamespace(paired_share=1.0),
        unlike_share=unlike,
    )
    peak = SimpleNamespace(relative_cost=1.0, comparison=comparison)
    assert faults.suspicious(None, peak) is expected  # type: ignore[arg-type]


def test_the_figure_whose_freedom_lowers_the_cost_most_is_tried_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a quadratic cost whose minima with and without each prior are known in closed form: one
    figure is known well and far off, one hardly known and near its prior."""
    rng = np.random.default_rng(5)
    n = faults.FIGURES_TRIED + 3
    J = rng.standard_normal((60, n)) * np.concatenate([np.full(n - 1, 2.0), [0.1]])
    truth = np.zeros(n)
    truth[1], truth[n - 1] = 6.0, 5.0
    measured = J @ truth + rng.standard_normal(60)

    def least_cost(precision: np.ndarray) -> tuple[np.ndarray, float]:
        u = np.linalg.solve(J.T @ J + precision, J.T @ measured)
        return u, float(((measured - J @ u) ** 2).sum() + u @ precision @ u)

    u, cost = least_cost(np.eye(n))
    drops = []
    for number in range(n):
        precision = np.eye(n)
        precision[number, number] = 0.0
        drops.append(cost - least_cost(precision)[1])
    fit: Any = SimpleNamespace(
        variances=lambda *_: np.ones(60),
        coordinates=SimpleNamespace(prior_precision=np.eye(n), origin=np.zeros(n), n_dim=n),
    )
    every = [SensorFault(str(i), str(i), fit, (0,), (1.0,), (i,)) for i in range(n)]
    monkeypatch.setattr(faults, "_wrong_figures", lambda *_: iter(every))
    comparison: Any = SimpleNamespace(jacobian=J)
    found = faults._likeliest_figures(fit, JointPeak(u, comparison, cost, 60))
    expected = np.argsort(-np.array(drops))[: faults.FIGURES_TRIED]
    assert [int(each.name) for each in found] == expected.tolist()
    assert found[0].name == "1"


@pytest.mark.parametrize("turns", [True, False])
def test_all_sensors_are_turned_by_the_angles_that_are_worth_a_name(
    turns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each in standard deviations of a heading's prior; none where no heading can be wrong."""
    all_turned = fault(faults.ALL_TURNED) if turns else None
    monkeypatch.setattr(faults, "fault_named", lambda *_: all_turned)
    figures = [SimpleNamespace(kind="gain", std=0.03), SimpleNamespace(kind="heading", std=2.0)]
    fit: Any = Fit(SimpleNamespace(figures=figures))
    found = faults.turned_by(fit, [30.0, -4.9, 0.0, -5.0, 5.0])
    assert found == ([(all_turned, 15.0), (all_turned, -2.5), (all_turned, 2.5)] if turns else [])


@pytest.mark.parametrize(
    ("n_modes", "n_left_out", "named"), [(2, 2, False), (12, 2, True), (2, 0, True)]
)
def test_a_sensor_is_not_left_out_for_a_few_mixed_modes(
    n_modes: int, n_left_out: int, named: bool
) -> None:
    """Of twelve: without a sensor less of a mixed mode's shape is compared, which is no sign that
    it reads nothing. A fault that puts a shape right is one."""

    def end(far_off: int) -> JointPeak:
        groups = np.repeat(np.arange(12), 6)
        errors = np.where(groups < far_off, 5.0, 0.9)
        comparison = SimpleNamespace(
            is_frequency=np.zeros(groups.size, dtype=bool),
            errors=errors,
            groups=groups,
            unlike_shapes=0,
        )
        return JointPeak(np.zeros(3), comparison, float((errors**2).sum()), groups.size)  # type: ignore[arg-type]

    fit: Any = SimpleNamespace(
        sensors=NoFigures(),
        variances=lambda found, sigma: np.ones(found.groups.size),
        settled=lambda evidence, u: end(n_modes),
    )
    channels = tuple(range(n_left_out))
    named_fault = SensorFault("85 m", "nothing explains it", fit, (0,), (1.0,), left_out=channels)
    evidence: Any = None
    found = faults.still_explained(named_fault, fit, evidence, end(0))
    assert (found is not None) is named
