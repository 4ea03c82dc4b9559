"""What takes too long is given up in one line."""

import signal

import pytest

from pipeline.cli.console import no_longer_than
from sensors.errors import InputError


def test_an_import_that_takes_too_long_is_given_up_in_one_line() -> None:
    def endless() -> None:
        with no_longer_than(0.05):
            while True:
                pass

    with pytest.raises(InputError, match=r"the import takes longer than 0\.05 s and is given up"):
        endless()
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_what_is_done_in_time_is_done() -> None:
    with no_longer_than(60.0):
        pass
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    with pytest.raises(InputError, match="a positive number"), no_longer_than(0.0):
        pass
