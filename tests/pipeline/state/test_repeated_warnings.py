"""One cause is one line, whatever figures each window gives it."""

from pipeline.messages import QualityWarning
from pipeline.state.repeated_warnings import DistinctWarnings


def _twins(frequency: str, code: str = "twin-modes") -> QualityWarning:
    return QualityWarning(code, f"two modes near {frequency} Hz are too alike (-3.1 %).")


def test_the_same_cause_of_many_windows_is_said_once_as_first_said() -> None:
    said = [_twins(f) for f in ("2.37", "2.376", "2.375", "2.37")]
    assert [*DistinctWarnings(said)] == [said[0]]


def test_another_figure_another_code_and_other_words_stay() -> None:
    said = [
        _twins("2.37"),
        _twins("11.6"),
        _twins("2.37", "pair"),
        QualityWarning("twin-modes", "a mode m46 that was not seen before"),
        QualityWarning("twin-modes", "a mode m47 that was not seen before"),
        QualityWarning("clock", "steps by 0 s"),
        QualityWarning("clock", "steps by 1e-3 s"),
    ]
    assert [*DistinctWarnings(said)] == said


def test_a_value_that_drifts_is_said_again() -> None:
    said = [_twins(f"{1 + 0.02 * k:.3f}") for k in range(15)]
    assert [each.text for each in DistinctWarnings(said)] == [
        _twins(f"{first:.3f}").text for first in (1.0, 1.06, 1.16, 1.26)
    ]
