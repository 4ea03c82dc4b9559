"""Shapes along the nacelle's axes: sensors are fixed to the tower, fore-aft follows the nacelle."""

from dataclasses import replace

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import normalised_to, renormalised_factor
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.errors import InputError


def in_nacelle_axes(estimate: ModalEstimate, layout: SensorLayout) -> ModalEstimate:
    """The estimate with its shapes turned from the tower's axes to those of the yawed nacelle.

    Sensors are fixed to the tower while fore-aft follows the nacelle. Two axes at one height span
    the horizontal motion there, whatever their directions; it is read again along the layout's own
    directions after a turn by −yaw. Unchanged where the yaw is 0 or unknown.
    """
    if not np.isfinite(estimate.yaw) or abs(estimate.yaw) < 1e-9:
        return estimate
    by_name = {channel.name: channel for channel in layout.channels}
    if not by_name.keys() >= set(estimate.channels):
        return estimate  # the updater refuses channels that the layout does not have
    measured = replace(layout, channels=tuple(by_name[name] for name in estimate.channels))
    turn = turning_matrix(measured, estimate.yaw)
    return replace(estimate, modes=tuple(_turned(mode, turn) for mode in estimate.modes))


def turning_matrix(layout: SensorLayout, yaw: float) -> FloatArray:
    """(n_channels, n_channels): readings along tower axes → along nacelle axes, yaw [deg].

    Raises InputError for a height with one axis alone, whose motion across is not known.
    """
    angle = np.radians(yaw)
    to_nacelle = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turn = np.zeros((len(layout.channels), len(layout.channels)))
    for elevation in np.unique(layout.elevations):
        own = np.flatnonzero(layout.elevations == elevation)
        axes = layout.directions[own, :2]
        if np.linalg.matrix_rank(axes, tol=0.1) < 2:
            raise InputError(
                f"layout {layout.layout_id} has one direction only at {elevation:g} m; a nacelle "
                f"yawed by {yaw:g} deg needs two"
            )
        turn[np.ix_(own, own)] = axes @ to_nacelle @ np.linalg.pinv(axes)
    return turn


def _turned(mode: Mode, turn: FloatArray) -> Mode:
    shape = turn @ mode.shape
    unit = int(np.argmax(np.abs(shape)))
    factor = mode.covariance_factor.copy()
    factor[2:] = renormalised_factor(shape, turn @ mode.covariance_factor[2:], unit)
    return replace(mode, shape=normalised_to(shape, unit), covariance_factor=factor)
