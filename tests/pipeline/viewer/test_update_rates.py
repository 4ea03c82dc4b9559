"""How fast a recording is played."""

from dataclasses import replace

import pytest

from pipeline.viewer.update_rates import TO_VIEWER


@pytest.mark.parametrize("swing", [0.5, 18.0, 60.0])
def test_a_shape_swings_in_two_seconds_of_playback_whatever_its_period(swing: float) -> None:
    assert swing / replace(TO_VIEWER, swing=swing).playback_speed == pytest.approx(2.0)
