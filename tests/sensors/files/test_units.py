"""Units of files against their prefixes and what they are prefixes of."""

import re

import pytest

from sensors.files.table import ACCELERATION_UNITS, DISPLACEMENT_UNITS, VELOCITY_UNITS

PREFIXES = {"": 1.0, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
BASES = {"m": 1.0, "ft": 12 * 0.0254, "in": 0.0254, "g": 9.80665, "gal": 1e-2}  # SI, exact
EVERY = ACCELERATION_UNITS | VELOCITY_UNITS | DISPLACEMENT_UNITS
OTHER_NAMES = {"gn", "g_n", "g's", "gs", "g0", "gee"}  # of standard gravity


@pytest.mark.parametrize("unit", sorted(EVERY))
def test_a_unit_is_its_prefix_times_its_base(unit: str) -> None:
    if unit in OTHER_NAMES:
        assert EVERY[unit] == BASES["g"]
        return
    length = re.sub(r"(/s2|/s\^2|/s/s|/s|\*?s-2|\*?s-1)$", "", unit)
    read = [
        scale * BASES[length.removeprefix(prefix)]
        for prefix, scale in PREFIXES.items()
        if length.startswith(prefix) and length.removeprefix(prefix) in BASES
    ]
    assert EVERY[unit] == pytest.approx(read[0], rel=1e-12)
