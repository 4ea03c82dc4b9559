"""Work that may be given up is, at its next checkpoint and not before."""

from itertools import count

import pytest

from pipeline.oma.work_limit import CpuLimit, WorkLimitExceeded, checkpoint, working_within


def test_work_within_its_time_goes_on_and_beyond_it_is_given_up() -> None:
    seconds = count()
    with working_within(CpuLimit(3.5, lambda: float(next(seconds)))):  # begins at 0
        for _ in range(3):
            checkpoint()
        with pytest.raises(WorkLimitExceeded):
            checkpoint()
    checkpoint()  # outside of it there is no limit
