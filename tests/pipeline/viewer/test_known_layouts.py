"""Layouts are found by their names: a unit's, and that of all units together."""

from dataclasses import replace

import numpy as np

from pipeline.viewer.signal_view import KnownLayouts
from sensors.acquisition.layout import biaxial_layout, joined_layout
from tests.pipeline.example_estimates import estimate
from tests.pipeline.state.test_posterior_json import POSTERIOR

LOWER = biaxial_layout("low", turbine="t1", unit="a", elevations=[20.0])
UPPER = biaxial_layout("high", turbine="t1", unit="b", elevations=[60.0, 80.0])


def known(*layouts: object) -> KnownLayouts:
    found = KnownLayouts()
    for each in layouts:
        found.add(each)  # type: ignore[arg-type]
    return found


def test_every_layout_is_found_by_its_own_name_and_no_other() -> None:
    both = known(UPPER, LOWER)
    assert both.all == (UPPER, LOWER)
    assert both.named("low") is LOWER
    assert both.named("high") is UPPER
    assert both.named("neither") is None
    assert known().named("low") is None


def test_all_units_together_have_the_name_that_the_identification_gives_them() -> None:
    together = joined_layout([LOWER, UPPER])  # in the order of their names, as windows have them
    found = known(UPPER, LOWER).named(together.layout_id)
    assert found == together
    assert known(UPPER, LOWER).units_of(together.layout_id) == (LOWER, UPPER)
    renewed = replace(UPPER, layout_id="high, turned")
    assert known(UPPER, LOWER, renewed).named(together.layout_id) is None


def test_a_posterior_gets_the_layout_whose_channels_its_shapes_have() -> None:
    both = known(LOWER, UPPER)
    for layout in (LOWER, UPPER):
        posterior = replace(POSTERIOR, model_shapes=np.ones((3, len(layout.channels))))
        assert both.of_posterior(posterior, None) is layout
        of = replace(estimate(0), layout_id=layout.layout_id, channels=layout.channel_names)
        assert both.of_posterior(posterior, of) is layout
        assert both.of_posterior(posterior, replace(of, layout_id="neither")) is None
        assert both.of_posterior(posterior, replace(of, channels=layout.channel_names[:1])) is None


def test_a_posterior_of_an_unknown_window_gets_no_layout_where_two_have_as_many_channels() -> None:
    """In whose order its shapes are, nothing tells."""
    turned = replace(UPPER, layout_id="turned", channels=UPPER.channels[::-1])
    posterior = replace(POSTERIOR, model_shapes=np.ones((3, len(UPPER.channels))))
    assert known(UPPER, turned).of_posterior(posterior, None) is None
