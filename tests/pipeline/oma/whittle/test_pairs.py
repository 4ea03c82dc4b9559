"""What two entries of a pair say of their frequencies and of where in the plane they lie."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.whittle.fit import WhittleFit
from pipeline.oma.whittle.pair_axes import along_axes, modal_powers, principal_axes
from pipeline.oma.whittle.pairs import Partner, joint_pair
from pipeline.oma.whittle.spectral_model import modal_spectra
from tests.pipeline.oma.whittle.test_spectral_model import two_modes


def test_a_partner_of_a_twentyfifth_of_the_power_leaves_the_shape_a_fifth_of_its_direction() -> (
    None
):
    """The angle in the plane has the std √(power share)."""
    leader = Mode("", 1.0, 1e-3, 0.01, 1e-3, np.array([1.0, 0.5]), np.zeros((4, 1)), 0)
    partner = Partner(np.array([-0.5, 1.0]), power_share=0.04, noise_share=0.0)
    first, _ = joint_pair(leader, np.full(2, 1.0), np.zeros(2), partner)
    across = partner.shape - leader.shape * partner.shape[0]  # its unit component stays 1
    np.testing.assert_allclose(first.shape_std, 0.2 * np.abs(across), atol=1e-12)


def test_frequencies_of_a_pair_are_known_to_half_a_line_at_best() -> None:
    """However exact a fit is: which of the two is which, the window does not know."""
    modes, band = two_modes()
    modes = replace(modes, positions=np.array([100.3, 100.5]))
    n_parameters = 3 * 2 + 4 + 2 * 3
    fit = WhittleFit(modes, 0.0, np.eye(n_parameters), np.eye(n_parameters), True)
    axes = along_axes(fit, band, (0, 1), np.zeros((n_parameters, 1)))
    for mode in (axes.stronger, axes.weaker):
        assert mode.frequency_std * band.duration == pytest.approx(0.5, rel=0.1)
        low, high = np.sort(modes.half_widths / np.hypot(modes.positions, modes.half_widths))
        assert low <= mode.damping_ratio <= high


def test_axes_that_mean_frequencies_tell_apart_are_turned_by_what_these_leave() -> None:
    """Amplitudes 1 and .2, an angle of .1 in units of each: .02 of one, .5 of the other."""
    partner = Partner(np.ones(2), power_share=0.04, noise_share=0.0, turn=0.1)
    assert partner.turns == pytest.approx((0.02, 0.5))


def test_principal_axes_are_the_two_strongest_of_all_channels() -> None:
    shapes = np.zeros((4, 2))
    shapes[1, 0], shapes[3, 1] = 1.0, 1.0
    share, axes = principal_axes(shapes, np.diag([4.0, 1.0]), np.ones((4, 1)))
    assert share == pytest.approx(0.25)
    np.testing.assert_allclose(np.abs(axes.T), [[0, 1, 0, 0], [0, 0, 0, 1]], atol=1e-12)


def test_no_axis_holds_more_of_the_other_than_all_of_it() -> None:
    assert Partner(np.ones(2), power_share=4.0, noise_share=0.0).turns == (1.0, 1.0)
    assert Partner(np.ones(2), power_share=4.0, noise_share=0.0, turn=1.0).turns == (1.0, 0.5)
    assert Partner(np.ones(2), power_share=0.25, noise_share=0.0, turn=1.0).turns == (0.5, 1.0)


@pytest.mark.parametrize("apart", [0.5, 1.0, 3.0])
def test_two_modes_of_a_pair_are_correlated_as_the_sum_of_their_spectrum_is(apart: float) -> None:
    """Two routes; correlated forces of one strength, half a line wide, a background's colour."""
    modes, _ = two_modes()
    modes = replace(
        modes,
        positions=np.array([200.0, 200.0 + apart]),
        half_widths=np.full(2, 0.5),
        forces=np.array([[1.0, 0.0], [0.999, 0.0447]], dtype=complex),
        colours=np.full(2, -1.0),
    )
    fit = WhittleFit(modes, 0.0, np.eye(16), np.eye(16), True)
    found = modal_powers(fit, np.arange(2))
    summed = modal_spectra(modes, np.arange(100.0, 301.0)).sum(axis=0).real
    one, other = (
        each[0, 1] / np.sqrt(each[0, 0] * each[1, 1]) for each in (found, np.asarray(summed))
    )
    assert one == pytest.approx(other, abs=0.01)
