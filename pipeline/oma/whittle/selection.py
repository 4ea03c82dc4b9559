"""How many modes a narrow band holds: one more at a time, as long as the evidence rises."""

from pipeline.oma.whittle.fit import WhittleFit, cost_of_background, fitted
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.starts import (
    left_unexplained,
    strongest,
    told_apart_by_place,
    with_another,
)

NEEDED_EVIDENCE = 3.0  # that a further mode must bring, ln of the Bayes factor [nats]

WORTH_A_TRY = 10.0  # rise of ln p that whitened lines promise before a mode more is fitted [nats]


def fits_in_turn(band: NarrowBand, *, most_modes: int, half_width: float) -> list[WhittleFit]:
    """The best fits of one mode, two and so on, until a further one brings no evidence; none
    where a flat background explains the lines as well.

    half_width   b = ζ f T to begin with [lines]
    """
    n_channels = len(band.scales)
    first = fitted(strongest(band, half_width), band)
    if first.bayes_cost(band.n_lines) > cost_of_background(band) - NEEDED_EVIDENCE:
        return []
    found = [first]
    for n_modes in range(2, min(most_modes, n_channels) + 1):
        best = found[-1]
        place = left_unexplained(best.modes, band, half_width)[0]
        if place.gain < WORTH_A_TRY:
            break
        needed = best.bayes_cost(band.n_lines) - NEEDED_EVIDENCE
        apart = told_apart_by_place(band, n_modes, half_width, best.modes.noise)
        further = fitted(apart, band) if apart is not None else best
        if further.bayes_cost(band.n_lines) > needed:
            further = fitted(with_another(best.modes, band, half_width, place), band)
        if further.bayes_cost(band.n_lines) > needed:
            break
        found.append(further)
    return found
