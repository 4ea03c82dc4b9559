"""The poles of a window as a message, for people to look at."""

from collections.abc import Sequence

import numpy as np

from pipeline.messages import ModalEstimate, StabilisationDiagram
from pipeline.oma.ssi.stabilization import PoleCloud


def stabilisation_diagram(
    estimate: ModalEstimate, bands: Sequence[PoleCloud]
) -> StabilisationDiagram:
    """Poles of all bands side by side, in single precision: nobody computes with them.

    bands   the poles behind the estimate by frequency band, slowest first
    """
    poles = {
        "orders": [band.orders for band in bands],
        "bands": [np.full(len(band), index) for index, band in enumerate(bands)],
        "frequencies": [band.frequencies for band in bands],
        "frequency_stds": [band.frequency_stds for band in bands],
        "damping_ratios": [band.damping_ratios for band in bands],
    }
    return StabilisationDiagram(
        estimate.turbine,
        estimate.window,
        estimate.start_ns,
        estimate.end_ns,
        **{name: np.concatenate([*parts, []]).astype(np.float32) for name, parts in poles.items()},
    )
