"""A title's name and its unit."""

import pytest

from sensors.files.text.column_titles import split_unit


@pytest.mark.parametrize(
    ("title", "name", "unit"),
    [
        ("top [mm/s]", "top", "mm/s"),
        ("top [volts of old]", "top", "volts of old"),
        ("top (m/s²)", "top", "m/s²"),
        ("top, mg", "top", "mg"),
        ("top / g", "top", "g"),
        ("time (s)", "time", "s"),
        ("Acc (X)", "Acc (X)", ""),
        ("Acc, north", "Acc, north", ""),
        ("top", "top", ""),
        ("", "", ""),
    ],
)
def test_what_stands_in_round_brackets_or_behind_is_a_unit_where_one_is_known(
    title: str, name: str, unit: str
) -> None:
    assert split_unit(title) == (name, unit)
