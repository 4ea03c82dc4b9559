"""Modal estimates drawn about a model's modes with errors of known law: streams without samples.

What identifying ten minutes would take a second for is drawn in a millisecond, and the law of the
errors is known: a posterior that doesn't hold the truth as often as it says has no excuse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import complex_normalised, renormalised_factor
from pipeline.updating.forward_model import ForwardModel
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine

DAMPING = 0.007  # ζ, of every mode [-]
DURATION = 600.0  # T, of a window [s]
SHAPE_STD = 0.01  # of a component other than the largest [-]
LAYOUT = biaxial_layout(
    "drawn", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
PAPERS_MODES = tuple(str(number) for number in range(1, 12))


def turbine_model(labels: Sequence[str] | None = PAPERS_MODES) -> ModalModel:
    """The IEA 15 MW turbine with the paper's modes, or with all that the sensors see (None)."""
    model = ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)
    return model if labels is None else model.subset(labels)


@dataclass(frozen=True, slots=True, eq=False)
class TrueModes:
    """What the estimates are drawn about. Rows of (n_modes, 1 + n_channels): f [Hz], then φ [-]."""

    labels: tuple[str, ...]
    values: FloatArray  # largest component of each shape 1
    deviations: FloatArray  # of one window's estimate; 0 for the largest component
    layout: SensorLayout

    @classmethod
    def of(
        cls, model: ForwardModel, ratios: FloatArray, layout: SensorLayout = LAYOUT
    ) -> "TrueModes":
        """Modes at (3,) ratios with standard deviations as ten minutes give at best.

            std f / f = √(ζ / (2π f T))

        Source: Gersch (1974), Journal of Sound and Vibration 34: the bound for one lightly damped
        mode in white noise.
        """
        modes = model.modal((model.nominal * ratios)[None])
        shapes = complex_normalised(modes.shapes[0])
        frequencies = modes.frequencies[0]
        values = np.column_stack([frequencies, shapes])
        deviations = np.full_like(values, SHAPE_STD)
        deviations[:, 0] = frequencies * np.sqrt(DAMPING / (2 * np.pi * frequencies * DURATION))
        deviations[np.arange(len(values)), 1 + np.argmax(np.abs(shapes), axis=1)] = 0.0
        return cls(model.labels, values, deviations, layout)

    @property
    def reference(self) -> FloatArray:
        """√R, (n_modes, 1 + n_channels): what σ multiplies [Hz, -]; 0 for the largest component."""
        norms = np.linalg.norm(self.values[:, 1:], axis=1)
        root = np.where(self.deviations > 0, norms[:, None], 0.0)
        root[:, 0] = self.values[:, 0]
        return root


def drawn_window(
    true: TrueModes,
    errors: FloatArray,
    *,
    window: int,
    hop: float = DURATION,
    discrepancy: FloatArray | float = 0.0,
) -> ModalEstimate:
    """The estimate of one window, its covariances as they are.

    errors        (n_modes, 1 + n_channels) of unit variance
    hop           between the beginnings of two windows [s]
    discrepancy   (n_modes, 1 + n_channels) of the structure, beside the errors [Hz, -]
    """
    values = true.values + discrepancy + errors * true.deviations
    start = round(window * hop * NANOSECONDS)
    modes = [
        drawn_mode(label, row, deviation)
        for label, row, deviation in zip(true.labels, values, true.deviations, strict=True)
    ]
    return ModalEstimate(
        turbine=true.layout.turbine,
        window=window,
        start_ns=start,
        end_ns=start + round(DURATION * NANOSECONDS),
        layout_id=true.layout.layout_id,
        channels=true.layout.channel_names,
        modes=tuple(sorted(modes, key=lambda mode: mode.frequency)),
        weight=hop / DURATION,
    )


def drawn_mode(name: str, values: FloatArray, deviations: FloatArray) -> Mode:
    """One mode of f [Hz] and φ [-], (1 + n_channels,), with independent errors of these standard
    deviations, made to have its largest component 1."""
    shape = values[1:]
    largest = int(np.argmax(np.abs(shape)))
    factor = np.diag(np.insert(deviations, 1, 1e-4))  # ζ is the second row
    factor[2:] = renormalised_factor(shape, factor[2:], largest)
    return Mode(
        name=name,
        frequency=float(values[0]),
        frequency_std=float(deviations[0]),
        damping_ratio=DAMPING,
        damping_ratio_std=1e-4,
        shape=shape / shape[largest],
        covariance_factor=factor,
        n_block_columns=0,
    )
