"""A title's name and its unit."""

import pytest

from sensors.files.text.column_titles import distinct, split_unit


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


@pytest.mark.parametrize(
    ("titles", "names"),
    [
        (["top", "low"], ["top", "low"]),
        (["top", "top", "top"], ["top", "top.2", "top.3"]),
        (["top", "top", "top.2"], ["top", "top.3", "top.2"]),
        (["top.2", "top", "top"], ["top.2", "top", "top.3"]),
        (["top", "", ""], ["top", "ch2", "ch3"]),
        (["", "ch1"], ["ch1.2", "ch1"]),
        (["ch2", ""], ["ch2", "ch2.2"]),
    ],
)
def test_columns_have_names_of_their_own_and_none_takes_the_name_that_another_is_given(
    titles: list[str], names: list[str]
) -> None:
    assert distinct(titles) == names
    assert distinct(names) == names
