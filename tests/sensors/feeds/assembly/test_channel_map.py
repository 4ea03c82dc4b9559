"""What samples of a feed are multiplied by."""

import pytest

from sensors.feeds.assembly.channel_map import factor_of, factor_to
from sensors.files.layout_file import MappedChannel

G = 9.80665  # [m/s²]


@pytest.mark.parametrize(
    ("unit", "sensitivity", "stated", "factor"),
    [
        (None, None, "", 1.0),  # neither states it: m/s²
        (None, None, "g", G),
        ("mg", None, "", 1e-3 * G),
        ("mg", None, "g", 1e-3 * G),  # the layout's unit takes precedence
        ("g", 0.5, "", G / 0.5),
        ("g", 0.5, "V", G / 0.5),
        ("g", -2.0, "", -G / 2.0),
    ],
)
def test_samples_are_in_the_unit_of_the_layout_or_else_in_the_one_of_the_message(
    unit: str | None, sensitivity: float | None, stated: str, factor: float
) -> None:
    channel = MappedChannel("z", 80.0, (1.0, 0.0, 0.0), unit=unit, sensitivity=sensitivity)
    assert factor_of(channel, stated) == pytest.approx(factor)


@pytest.mark.parametrize(("stated", "factor"), [("", 1.0), ("g", G), ("µm/s²", 1e-6), ("mm", None)])
def test_only_units_of_an_acceleration_lead_to_one(stated: str, factor: float | None) -> None:
    assert factor_to(stated) == (factor if factor is None else pytest.approx(factor))
