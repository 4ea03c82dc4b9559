"""Structure: a turbine's description and the modes that it has on given springs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, one_blas_thread
from sensors.structure.description import TurbineDescription, load_turbine

from .errors import InputError, require
from .modes import channel_columns, draw_shapes

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from sensors.dynamics.modal_model import ModalModel


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StructureModes:
    """Natural frequencies and shapes that a structure has on given springs."""

    labels: tuple[str, ...]
    """Label of each mode; "1" to "11" are the publication's."""
    frequencies: FloatArray
    """(n_modes,) [Hz]"""
    shapes: FloatArray
    """(n_modes, n_channels) as the sensors read them, largest component 1 [-]"""
    channels: tuple[str, ...]
    """Channel names, in the order of the shapes' components."""

    layout: SensorLayout | None = None
    """Where the sensors are."""

    def __repr__(self) -> str:
        listed = ", ".join(f"{f:.4g}" for f in np.sort(self.frequencies)[:6])
        return f"<StructureModes: {len(self.labels)} modes: {listed}, … Hz>"

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row a mode: label, frequency_hz, then one column a channel."""
        pandas = require("pandas")
        rows = {"label": self.labels, "frequency_hz": self.frequencies}
        names = channel_columns(self.channels, rows).values()
        columns = dict(zip(names, self.shapes.T, strict=True))
        return pandas.DataFrame(rows | columns).sort_values("frequency_hz", ignore_index=True)

    def to_xarray(self) -> xr.Dataset:
        """Frequency and shape with the dimensions mode and channel, lowest frequency first."""
        xarray = require("xarray")
        order = np.argsort(self.frequencies)
        return xarray.Dataset(
            {
                "frequency": ("mode", self.frequencies[order]),
                "shape": (("mode", "channel"), self.shapes[order]),
            },
            coords={"mode": [self.labels[i] for i in order], "channel": list(self.channels)},
        )

    def plot(self, number: int = 12) -> Any:
        """Draw the shapes of the lowest modes, one panel a mode.

        Parameters
        ----------
        number : int
            Of modes.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes
        """
        order = np.argsort(self.frequencies)[:number]
        shapes, frequencies = self.shapes[order], self.frequencies[order]
        return draw_shapes(shapes, frequencies, self.channels, self.layout)


class Structure:
    """A monopile turbine: shipped by name, or read from a description file.

    Parameters
    ----------
    description : str, path or TurbineDescription
        "iea15mw_monopile", or the path of a TOML file (`pilewatch describe --template`).
    sign : str, optional
        Sign convention of k12; the description's by default.

    Raises
    ------
    InputError
        If the description cannot be read.
    """

    def __init__(
        self,
        description: str | os.PathLike[str] | TurbineDescription = "iea15mw_monopile",
        *,
        sign: str | None = None,
    ) -> None:
        if not isinstance(description, TurbineDescription):
            description = load_turbine(os.fspath(description))
        if sign is not None:
            if sign not in ("published", "embedded-pile"):
                raise InputError(f"sign is {sign!r}; it is 'published' or 'embedded-pile'")
            description = description.with_sign(sign)  # type: ignore[arg-type]  # checked above
        self.description = description
        """What the structure is made of."""

    @property
    def nominal(self) -> FloatArray:
        """(3,) nominal k11 [N/m], k22 [N·m/rad], k12 [N/rad]."""
        return np.asarray(self.description.nominal)

    def __repr__(self) -> str:
        return f"<Structure: {self.description.name}>"

    def model(self, layout: SensorLayout | None = None) -> ModalModel:
        """Return the reduced model that the updating evaluates, seen by the sensors of a layout."""
        from sensors.dynamics.modal_model import ModalModel

        return ModalModel(self.description, layout or self._default_layout())

    @one_blas_thread()
    def modes(
        self, ratios: Sequence[float] = (1.0, 1.0, 1.0), layout: SensorLayout | None = None
    ) -> StructureModes:
        """Modes on springs of `ratios` times the nominal k11, k22, k12.

        Parameters
        ----------
        ratios : sequence of 3 floats
            k11, k22, k12 over nominal [-].
        layout : SensorLayout, optional
            Sensors by which the shapes are read; the shipped scenario's by default: for a tower of
            another height at the same shares of it.

        Returns
        -------
        StructureModes

        Raises
        ------
        InputError
            If the springs are not positive definite.
        """
        if np.shape(ratios) != (3,):
            raise InputError(f"ratios are {ratios!r}; three are needed, of k11, k22 and k12")
        model = self.model(layout)
        modal = model.modal((np.asarray(ratios, dtype=np.float64) * model.nominal)[None])
        if not modal.admissible[0]:
            raise InputError(
                f"ratios are {tuple(ratios)}; k11·k22 must exceed k12² and the structure must "
                "stand under gravity"
            )
        seen = layout or self._default_layout()
        return StructureModes(
            tuple(model.labels),
            modal.frequencies[0],
            modal.shapes[0],
            tuple(seen.channel_names),
            seen,
        )

    def _default_layout(self) -> SensorLayout:
        from pipeline.offline.model_modes import default_layout

        return default_layout(self.description)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row a tube, lowest first: bottom, top, diameter, thickness [m]."""
        pandas = require("pandas")
        keys = ("bottom", "top", "diameter", "thickness")
        rows = [{f"{k}_m": getattr(tube, k) for k in keys} for tube in self.description.tubes]
        return pandas.DataFrame(rows)

    def plot(self) -> Any:
        """Draw the tubes of the structure to scale, the mudline and any water marked.

        Returns
        -------
        matplotlib.axes.Axes
        """
        pyplot = require("matplotlib.pyplot")
        _, axis = pyplot.subplots(figsize=(3, 7))
        for tube in self.description.tubes:
            half = tube.diameter / 2
            axis.fill_betweenx([tube.bottom, tube.top], -half, half, color="C0", alpha=0.6)
        water = self.description.water
        if water is not None:
            axis.axhline(water.level, color="C9", linewidth=1)
        axis.axhline(self.description.mudline, color="C5", linewidth=1)
        above = " above mean water level" if water is not None else ""
        axis.set(ylabel=f"elevation{above} [m]", xlabel="[m]", aspect="equal")
        return axis


def structure_of(given: Structure | str | os.PathLike[str]) -> Structure:
    """Return a Structure of what a caller gave: one already, or the name or path of a description.

    Raises
    ------
    InputError
        If the description cannot be read.
    """
    return given if isinstance(given, Structure) else Structure(given)
