"""What looked like a mode in a window and is not reported, each with its reason."""

from collections.abc import Sequence

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.oma.ssi.band_identification import BandIdentification
from sensors.arrays import FloatArray

DIAGRAM_COLUMN = (
    0.005  # poles within so much of each other look like one column of the diagram, relative
)
FEWEST_ORDERS = 0.3  # share of a band's orders from which a column catches the eye [-]
COVERED = 0.01  # a column so near to a mode or a refused one belongs to it, relative


def harmonic(mode: Mode) -> RefusedMode:
    """What keeps its amplitude as a machine's harmonic does."""
    return RefusedMode(
        mode.frequency,
        mode.damping_ratio,
        "harmonic",
        "keeps its amplitude as a machine's harmonic does, not as a mode under random loads",
    )


def between(mode: Mode, two: Sequence[Mode]) -> RefusedMode:
    """What a band of short lags takes for one mode and one of longer lags resolves as two."""
    below, above = two
    return RefusedMode(
        mode.frequency,
        mode.damping_ratio,
        "explained",
        f"explains nothing that the modes at {below.frequency:.4g} and {above.frequency:.4g} Hz do "
        "not, which longer lags resolve",
    )


def unsteady(mode: Mode, least: float) -> RefusedMode:
    """What too few model orders of its only band agree upon."""
    return RefusedMode(
        mode.frequency,
        mode.damping_ratio,
        "unstable",
        f"stable in {100 * mode.presence:.0f} % of the model orders of one rate only, "
        f"{100 * least:.0f} % are the least",
    )


def unstable(
    by_band: Sequence[BandIdentification],
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
) -> list[RefusedMode]:
    """Columns of poles in the stabilisation diagram that belong to nothing that is named.

    Each once, of the band that has most of its orders there.
    """
    named = [*(mode.frequency for mode in modes), *(each.frequency for each in refused)]
    found = [each for band in by_band for each in _columns(band, np.array(named))]
    kept: list[tuple[float, RefusedMode]] = []
    for presence, each in sorted(found, key=lambda entry: (-entry[0], entry[1].frequency)):
        if all(abs(each.frequency / other.frequency - 1) > COVERED for _, other in kept):
            kept.append((presence, each))
    return sorted((each for _, each in kept), key=lambda each: each.frequency)


def _columns(band: BandIdentification, named: FloatArray) -> list[tuple[float, RefusedMode]]:
    """Share of the orders, and what stands there."""
    poles = band.poles
    free = np.ones(len(poles), dtype=bool)
    if len(named):
        apart = np.abs(poles.frequencies[:, None] / named[None, :] - 1)
        free = apart.min(axis=1, initial=np.inf) > COVERED
    n_orders = len(band.band.orders)
    found: list[tuple[float, RefusedMode]] = []
    while free.any():
        near = np.abs(poles.frequencies[:, None] / poles.frequencies[None, :] - 1) <= DIAGRAM_COLUMN
        counts = np.where(free, (near & free).sum(axis=1), 0)
        members = near[int(np.argmax(counts))] & free
        free &= ~members
        orders = len(np.unique(poles.orders[members]))
        if orders < FEWEST_ORDERS * n_orders:
            continue
        frequency = float(np.median(poles.frequencies[members]))
        damping = float(np.median(poles.damping_ratios[members]))
        scatter = float(poles.frequencies[members].std() / frequency)
        text = (
            f"poles in {orders} of {n_orders} model orders, scattered by {100 * scatter:.2g} % or "
            "unlike in shape: no mode that most orders agree upon"
        )
        found.append((orders / n_orders, RefusedMode(frequency, damping, "unstable", text)))
    return found
