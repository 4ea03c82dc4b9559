"""What is found of a tower does not depend on how fast its logger samples."""

import numpy as np
import pytest

from pipeline.oma.identification import identify
from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.modal_model import full_modes
from sensors.simulation.tower import SimulatedTower, SimulationSettings
from sensors.structure.description import load_turbine
from tests.benchmarks.identification import match
from tests.tiers import and_at_night

LAYOUT = biaxial_layout("l", turbine="t", unit="tower", elevations=(41.0, 106.0, 145.0))
SEED = 292003
BENDING = (0.1573, 0.1586, 0.6298, 1.0764, 1.8163, 5.8584)  # of Table 1, for the foundation [Hz]


@pytest.mark.parametrize("rates", and_at_night([100], [50, 128, 200]))
def test_a_fast_loggers_record_shows_the_towers_slow_modes(rates: list[int]) -> None:
    """In bands of the record's own rate the mode at .63 Hz was found in none of 12 windows at
    100 Hz, and with it three others at 200 Hz."""
    turbine = load_turbine("iea15mw_monopile")
    truth = full_modes(turbine, LAYOUT, tube_refinement=2, highest_frequency=7.0)
    for rate in map(float, rates):
        settings = SimulationSettings(seed=SEED, duration=400.0, sampling_rate=rate)
        record = np.concatenate(list(SimulatedTower(turbine, LAYOUT, settings).samples()))
        found = identify(record.astype(np.float64), rate).modes
        for frequency in BENDING:
            true = int(np.argmin(np.abs(truth.frequencies - frequency)))
            nearest = match(found, float(truth.frequencies[true]), truth.shapes[true])
            assert nearest is not None, f"{frequency} Hz in a record at {rate:g} Hz"
