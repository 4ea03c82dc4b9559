"""Where SCADA reports a turning rotor, its harmonics are no modes of the structure."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.operating_state import OperationLog, OperationSettings, usable_estimate
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, START, cut
from tests.pipeline.oma.conftest import structure

WINDOW = 300.0  # [s]
WANDER, LOUD = 0.03, 4.0
FIRST, SECOND = 0.4, 1.3  # modes of the structure [Hz]
PASSING = 0.37  # 3P [Hz]
SPEED = 20 * PASSING  # of the rotor [rpm]


def turning() -> tuple[FloatArray, FloatArray]:
    """Samples (n, 2) beside 3P of a speed that wanders by 3 %, and the speed at each [rpm]."""
    known = structure([FIRST, SECOND], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    quiet = known.ambient_response(sampling_rate=RATE, duration=WINDOW, seed=3)
    time = np.arange(len(quiet)) / RATE
    speed = SPEED * (1 + WANDER * np.sin(2 * np.pi * time / 90))
    angle = 2 * np.pi * np.cumsum(speed / 60) / RATE
    blades = LOUD * quiet.std() * np.cos(3 * angle)
    return quiet + np.outer(blades, [1.0, 0.3]), speed


def controller(speed: FloatArray, period: float) -> list[ScadaSample]:
    every = round(period * RATE)
    return [
        ScadaSample(
            "t1", START + round(n / RATE * NANOSECONDS), "operating", 9.0, value, 0.0, 0.0, 5e6, 0.0
        )
        for n, value in enumerate(speed)
        if n % every == 0
    ]


def estimate(samples: FloatArray, reports: list[ScadaSample]) -> ModalEstimate:
    """Of one window, the controller's samples in their order of time among the blocks."""
    node = IdentificationNode(OmaSettings(window_duration=WINDOW, hop=WINDOW))
    messages = [(report.time_ns, report) for report in reports]
    messages += [(block.end_ns, block) for block in cut(samples)]
    said = list(node.handle(LAYOUT))
    for _, message in sorted(messages, key=lambda each: each[0]):
        said += node.handle(message)
    (found,) = (each for each in said if isinstance(each, ModalEstimate))
    return found


@pytest.mark.parametrize("period", [1.0, 10.0])
def test_blade_passing_is_no_mode_where_scada_reports_the_speed(period: float) -> None:
    samples, speed = turning()
    found = estimate(samples, controller(speed, period))
    frequencies = [mode.frequency for mode in found.modes]
    assert frequencies == pytest.approx([FIRST, SECOND], rel=0.01)
    assert found.rotor_speed == pytest.approx(SPEED, rel=0.01)


def test_blade_passing_where_the_speed_is_unknown_is_told_from_modes_by_its_amplitude() -> None:
    samples, _ = turning()
    found = estimate(samples, [])
    assert [mode.frequency for mode in found.modes] == pytest.approx([FIRST, SECOND], rel=0.01)
    assert "harmonic" in [warning.code for warning in found.warnings]


def test_a_standing_rotor_changes_no_byte_of_an_estimate() -> None:
    samples, speed = turning()
    standing = estimate(samples, controller(0 * speed, 10.0))
    silent = estimate(samples, [])
    for with_scada, without in zip(standing.modes, silent.modes, strict=True):
        assert with_scada.frequency == without.frequency
        assert (with_scada.covariance_factor == without.covariance_factor).all()


def test_the_speed_runs_straight_between_reports_and_leaves_out_what_is_not_known() -> None:
    log = OperationLog()
    first, *_, last = controller(np.linspace(6.0, 8.0, 601), 10.0)
    for report in (first, replace(first, time_ns=START + 10**10, rotor_speed=np.nan), last):
        log.note(report)
    end_ns = START + 40 * NANOSECONDS
    speed = log.rotor_speed(START, end_ns, 80)
    assert speed is not None
    assert speed[[0, 30, 60, 79]] == pytest.approx([6.0, 7.0, 8.0, 8.0])
    assert OperationLog().rotor_speed(START, end_ns, 80) is None


@pytest.mark.parametrize("reported", [False, True])
def test_a_rotor_that_nothing_reports_keeps_its_window_from_the_posterior(reported: bool) -> None:
    """Harmonics in noise, with and without the state by SCADA."""
    speed = turning()[1]
    angle = 2 * np.pi * np.cumsum(speed / 60) / RATE
    quiet = np.random.default_rng(4).standard_normal((len(speed), 2))
    blades = 3 * (np.cos(3 * angle) + 0.3 * np.cos(6 * angle))
    found = estimate(quiet + np.outer(blades, [1.0, 0.3]), controller(speed, 10.0) * reported)
    shown = [each.code for each in found.warnings if each.code == "turning-rotor"]
    assert shown == ([] if reported else ["turning-rotor"])
    answer = usable_estimate(found, OperationSettings(), None)
    assert isinstance(answer, WindowRejected)
    assert answer.code == ("operating-state" if reported else "turning-rotor")
