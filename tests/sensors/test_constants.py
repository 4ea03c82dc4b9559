"""Constants by their definitions, and where they come in."""

import pytest

from sensors.constants import DAY, STANDARD_GRAVITY
from sensors.files.table import in_standard_unit


def test_standard_gravity_and_a_day_are_what_they_are_defined_as() -> None:
    assert STANDARD_GRAVITY == 9.80665  # m/s², third CGPM (1901)
    assert DAY == 24 * 60 * 60  # s


@pytest.mark.parametrize(
    ("unit", "standard", "factor"),
    [
        *(("g", "m/s²", 9.80665), ("mg", "m/s²", 9.80665e-3), ("m/s²", "m/s²", 1.0)),
        *(("mm/s²", "m/s²", 1e-3), ("µm/s²", "m/s²", 1e-6), ("cm/s²", "m/s²", 1e-2)),
        *(("mm/s", "m/s", 1e-3), ("cm", "m", 1e-2), ("m", "m", 1.0), ("V", "V", 1.0)),
    ],
)
def test_a_unit_is_so_many_of_the_standard_one(unit: str, standard: str, factor: float) -> None:
    found, times = in_standard_unit(unit)
    assert (found, times) == (standard, pytest.approx(factor, rel=1e-12))
