"""How many modes a narrow band holds: one more at a time, as long as the evidence rises."""

from dataclasses import dataclass

from pipeline.oma.whittle.fit import WhittleFit, cost_of_background, every_parameter
from pipeline.oma.whittle.fit import fitted as fitted_along
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import CloseModes
from pipeline.oma.whittle.starts import (
    left_unexplained,
    strongest,
    told_apart_by_place,
    with_another,
)

NEEDED_EVIDENCE = 3.0  # that a further mode must bring, ln of the Bayes factor [nats]

WORTH_A_TRY = 10.0  # rise of ln p that whitened lines promise before a mode more is fitted [nats]


NEIGHBOUR_WIDTHS = 3.0  # half bandwidths that a band ends short of a neighbour,
NEIGHBOUR_LINES = 2.0  # and lines more


@dataclass(frozen=True, slots=True, eq=False)
class BandFit:
    """The modes that the evidence supports, and the band that they were fitted to."""

    fit: WhittleFit
    band: NarrowBand


@dataclass(frozen=True, slots=True)
class Needed:
    """The part of a band that may not be cut off."""

    low: float
    """Position [lines]."""
    high: float
    """Position [lines]."""

    def holds(self, position: float) -> bool:
        """Return whether a position [lines] lies in it."""
        return self.low <= position <= self.high


def best_fit(
    band: NarrowBand, needed: Needed, *, most_modes: int, half_width: float, one_colour: bool
) -> BandFit | None:
    """The fit of one mode, of two and so on, until a further one brings no evidence; None where a
    flat background explains the lines as well.

    What stands out beside the part that is needed shortens the band: that costs less than a mode
    more.

    half_width   b = ζ f T to begin with [lines]
    one_colour   of all modes of the band
    """
    n_channels = len(band.scales)

    def fitted(start: CloseModes, band: NarrowBand) -> WhittleFit:
        along = every_parameter(start.n_modes, n_channels, one_colour=one_colour)
        return fitted_along(start, band, along)

    best = fitted(strongest(band, half_width), band)
    while not needed.holds(float(best.modes.positions[0])):
        shorter = _short_of(best.modes.positions[0], band, needed, half_width)
        if shorter is None:
            break
        band = shorter
        best = fitted(strongest(band, half_width), band)
    if best.bayes_cost(band.n_lines) > cost_of_background(band) - NEEDED_EVIDENCE:
        return None
    while True:
        place = left_unexplained(best.modes, band, half_width)[0]
        if place.gain < WORTH_A_TRY:
            break
        shorter = _short_of(float(band.numbers[place.index]), band, needed, half_width)
        if shorter is not None:
            band = shorter
            best = fitted(best.modes, band)
            continue
        if best.modes.n_modes >= min(most_modes, n_channels):
            break
        least = best.bayes_cost(band.n_lines) - NEEDED_EVIDENCE
        apart = told_apart_by_place(band, best.modes.n_modes + 1, half_width, best.modes.noise)
        further = fitted(apart, band) if apart is not None else best
        if further.bayes_cost(band.n_lines) > least:
            further = fitted(with_another(best.modes, band, half_width, place), band)
        if further.bayes_cost(band.n_lines) > least:
            break
        best = further
    return BandFit(best, band)


def _short_of(
    position: float, band: NarrowBand, needed: Needed, half_width: float
) -> NarrowBand | None:
    """The band as far as a neighbour leaves it alone; None where that cuts off nothing.

    position   of the neighbour [lines]
    """
    if needed.holds(position):
        return None
    clear = NEIGHBOUR_WIDTHS * half_width + NEIGHBOUR_LINES
    if position < needed.low:
        chosen = band.numbers >= min(position + clear, needed.low)
    else:
        chosen = band.numbers <= max(position - clear, needed.high)
    return None if chosen.all() else band.only(chosen)
