"""The stabilisation diagram is drawn from what was identified."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.messages import RefusedMode
from pipeline.oma.identification import Identification, identify
from pipeline.report.stabilisation import draw_stabilisation, spectral_singular_values
from sensors.errors import InputError

pytestmark = pytest.mark.usefixtures("identified_once")

RATE = 20.0  # [Hz]


@pytest.fixture(scope="module")
def record() -> np.ndarray:
    """Noise through a resonance at 2 Hz, seen alike by two channels."""
    noise = np.random.default_rng(8).standard_normal(6000)
    y = np.zeros(6000)
    pole = np.exp((-0.02 + 1j) * 2 * np.pi * 2.0 / RATE)
    for k in range(2, len(y)):
        y[k] = 2 * pole.real * y[k - 1] - abs(pole) ** 2 * y[k - 2] + noise[k]
    scatter = np.random.default_rng(9).standard_normal((6000, 2))
    return np.outer(y, [1.0, 0.5]) + 0.1 * scatter


def test_the_largest_singular_value_peaks_at_the_resonance(record: np.ndarray) -> None:
    frequencies, singular_values = spectral_singular_values(record, RATE)
    assert frequencies[np.argmax(singular_values[:, 0])] == pytest.approx(2.0, abs=0.1)
    assert (singular_values[:, 0] >= singular_values[:, 1]).all()


def test_a_figure_is_written(record: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = tmp_path / "diagram.png"
    draw_stabilisation(identify(record, RATE), record, RATE, path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_figure_shows_the_records_spectrum(record: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    found, paths = identify(record, RATE), [tmp_path / "once.png", tmp_path / "louder.png"]
    for path, samples in zip(paths, (record, 1000 * record), strict=True):
        draw_stabilisation(found, samples, RATE, path)
    assert paths[0].read_bytes() != paths[1].read_bytes()


def test_a_folder_that_is_not_there_is_one_clear_line(record: np.ndarray, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    with pytest.raises(InputError, match=r"cannot write the figure .*No such file"):
        draw_stabilisation(identify(record, RATE), record, RATE, tmp_path / "none" / "a.png")


def test_the_figure_names_modes_and_why_others_were_refused(tmp_path: Path) -> None:
    """An SVG has each text as a comment beside its outlines."""
    pytest.importorskip("matplotlib")
    refused = (RefusedMode(3.0, 0.4, "too-damped", ""), RefusedMode(5.0, 0.01, "rotor", ""))
    path, noise = tmp_path / "diagram.svg", np.random.default_rng(2).standard_normal((200, 1))
    mode = SimpleNamespace(frequency=1.234)
    draw_stabilisation(Identification((mode,), refused=refused), noise, RATE, path, title="Tower")  # type: ignore[arg-type]
    drawn = path.read_text("utf-8")
    for text in ("1.234 Hz", "too-damped", "rotor", "Tower: 1 mode; bars are"):
        assert f"<!-- {text}" in drawn
