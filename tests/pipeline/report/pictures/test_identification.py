"""Legends stay within their axes; each rate of a unit has its own spectra."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.report.canvas import PageFigure
from pipeline.report.page import _instruments
from pipeline.report.pictures import identification
from pipeline.report.pictures.identification import LONG_NAME, shortened
from pipeline.report.recorded_session import TurbineRecord
from tests.pipeline.example_messages import LAYOUT, block


def test_a_long_name_loses_its_middle() -> None:
    assert shortened("z145-fa") == "z145-fa"
    assert shortened("Acceleration top 92 m langskibs") == "Acceleration …2 m langskibs"
    assert len(shortened(80 * "x")) == LONG_NAME + 1


@pytest.mark.parametrize(("rates", "named"), [((40,), "at 40 Hz"), ((40, 80), "at 40 and 80 Hz")])
def test_spectra_of_each_rate_are_drawn_and_named(
    monkeypatch: pytest.MonkeyPatch, rates: tuple[int, ...], named: str
) -> None:
    record, drawn = TurbineRecord("t1"), []
    record.run.fold(LAYOUT)
    for rate in rates:
        for number in range(20):
            samples = np.repeat(block(number).samples, rate // 40, axis=0)
            message = replace(
                block(number), session=f"at-{rate}", first_sample=number * rate,
                sampling_rate=float(rate), samples=samples,
            )  # fmt: skip
            record.run.fold(message)
            record.signals.fold(message)
    assert named in _instruments(record)
    monkeypatch.setattr(PageFigure, "svg", lambda made: drawn.append(made.figure) or "")
    identification.spectra(record)
    lines = [line for axes in drawn[0].axes for line in axes.lines if "z145-fa" in line.get_label()]
    labels = ["z145-fa, 40 Hz", "z145-fa, 80 Hz"] if len(rates) > 1 else ["z145-fa"]
    assert [line.get_label() for line in lines] == labels
    assert [line.get_xdata()[-1] for line in lines] == [rate / 2 for rate in rates]
