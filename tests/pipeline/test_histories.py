"""Histories of kills, reboots, clock steps, cuts and strays leave books that balance."""

import pytest

from tests.pipeline.histories import complaints, shrunk


@pytest.mark.parametrize("seed", range(25))
def test_books_balance_and_kills_change_nothing(seed: int) -> None:
    found = complaints(seed)
    assert not found, f"seed {seed}: {found}; what is needed for it: {shrunk(seed)}"
