"""What the messages say of themselves."""

import math
from dataclasses import MISSING, fields

import numpy as np
import pytest

from pipeline.messages import (
    FoundationPosterior,
    ModalEstimate,
    Mode,
    ParameterSummary,
    without_covariances,
)
from pipeline.nodes.node import NodeStatistics
from pipeline.streams import STREAMS
from pipeline.transport.codec import decode, encode
from tests.pipeline.example_messages import START_NS, block
from tests.pipeline.report.example_session import estimate

FACTOR = np.array([[0.003, 0.0], [0.0, 0.001], [0.0, 0.0], [0.3, 0.4]])


def mode(shape: list[float]) -> Mode:
    return Mode("2", 0.1587, 0.003, 0.007, 0.001, np.array(shape), FACTOR, n_block_columns=2)


def test_a_mode_is_normalised_to_its_largest_component_whatever_the_sign() -> None:
    assert mode([-0.8, 1.0]).unit_component == 1
    assert mode([-1.0, 0.9]).unit_component == 0


def test_a_modes_covariance_has_the_variances_on_its_diagonal() -> None:
    identified = mode([1.0, 0.5])
    variances = [0.003**2, 0.001**2, 0.0, 0.3**2 + 0.4**2]
    assert np.diag(identified.covariance) == pytest.approx(variances)
    assert identified.shape_std == pytest.approx([0.0, 0.5])


def test_an_estimate_of_ten_minutes_lasts_600_seconds() -> None:
    end_ns = START_NS + 600 * 10**9
    estimate = ModalEstimate("t1", 0, START_NS, end_ns, "four-levels", (), ())
    assert estimate.duration == pytest.approx(600.0)


@pytest.mark.parametrize("kind", [each.message for each in STREAMS])
def test_what_a_message_leaves_out_is_nothing_or_not_known(kind: type) -> None:
    """An older recording lacks it: a count is 0 there, a text empty, a condition not known."""
    meant = {("ModalEstimate", "weight"): 1.0, ("FoundationPosterior", "trusted"): True}
    for each in fields(kind):
        expected = meant.get((kind.__name__, each.name))
        if each.default is MISSING:
            continue
        unknown = isinstance(each.default, float) and math.isnan(each.default)
        if expected is None:
            assert not each.default or unknown, each.name
        else:
            assert each.default == expected


def test_statistics_of_nothing_add_nothing() -> None:
    counted = NodeStatistics(lost=1, late=2, duplicate=3, recorded=4)
    assert counted + NodeStatistics() == counted == NodeStatistics() + counted


def test_one_block_ends_where_the_next_begins() -> None:
    assert block(3).end_ns == block(4).start_ns
    assert block(3).duration == 1.0


def test_a_posterior_gives_its_parameters_by_name() -> None:
    k22 = ParameterSummary("k22", "N·m/rad", 8.238e11, 8.1e11, 8.0e11, 8.2e11)
    posterior = FoundationPosterior(
        *["t1", 0, START_NS, 1, (k22,), np.eye(3), np.zeros((0, 4)), (), ()],
        *[np.zeros(0), np.zeros((0, 8)), "emcee", 1e3, 1.0, 6.0, 1.1, 0.9, 1.4],
    )
    assert posterior.parameter("k22") is k22
    with pytest.raises(KeyError):
        posterior.parameter("k33")


def test_an_estimate_without_covariances_holds_nothing_of_them() -> None:
    """A live state keeps thousands: 140 kB each, while a slice kept what it was cut from."""
    received = decode(ModalEstimate, encode(estimate(0)))
    for mode, whole in zip(without_covariances(received).modes, received.modes, strict=True):
        assert mode.covariance_factor.shape == (len(whole.covariance_factor), 0)
        assert mode.covariance_factor.base is None
        assert mode.n_block_columns == 0
        assert mode.frequency_std == whole.frequency_std
