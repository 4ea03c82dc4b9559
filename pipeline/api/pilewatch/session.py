"""Session: a recording with the results that it holds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.messages import FoundationEvent, FoundationPosterior, ModalEstimate, WindowRejected
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.arrays import FloatArray

from .errors import InputError, require
from .measurement import Measurement, read
from .modes import Modes
from .posterior import SPRINGS, Posterior

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Session:
    """What was recorded of one turbine: its modes, posteriors and events."""

    path: Path
    """The recording."""
    turbine: str
    """Whose results these are."""
    modes: Modes
    """Modes of every identified window, and the rejected ones."""
    posteriors: tuple[Posterior, ...]
    """After each window that entered, in order of time."""
    events: tuple[FoundationEvent, ...]
    """Changes of the structure that were noticed."""

    @property
    def posterior(self) -> Posterior | None:
        """The last posterior; None where there is none."""
        return self.posteriors[-1] if self.posteriors else None

    def measurement(self) -> Measurement:
        """Return the turbine's recorded samples, of all parts of the session, read when they are
        asked for."""
        return read(self.path, turbine=self.turbine)

    def __repr__(self) -> str:
        return (
            f"<Session {self.path.name}: {self.turbine}, {len(self.modes.estimates)} windows, "
            f"{len(self.posteriors)} posteriors, {len(self.events)} events>"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """The posterior over time: median, 5 % and 95 % quantile of each spring over nominal."""
        pandas = require("pandas")
        rows = []
        for posterior in self.posteriors:
            row = {"time": pandas.Timestamp(posterior.message.time_ns, tz="UTC")}
            quantiles = posterior.quantiles
            for number, name in enumerate(SPRINGS):
                for label, value in zip(
                    ("p05", "median", "p95"), quantiles[:, number], strict=True
                ):
                    row[f"{name}_{label}"] = value
            rows.append(row | {"trusted": posterior.trusted})
        return pandas.DataFrame(rows)

    def to_xarray(self) -> xr.Dataset:
        """The posterior over time: each spring over nominal with the dimensions time, quantile."""
        xarray = require("xarray")
        quantiles = self._quantiles()
        springs = {
            name: (("time", "quantile"), quantiles[:, :, number])
            for number, name in enumerate(SPRINGS)
        }
        trusted = ("time", [posterior.trusted for posterior in self.posteriors])
        times = np.array([each.message.time_ns for each in self.posteriors], dtype="datetime64[ns]")
        coordinates = {"time": times, "quantile": list(QUANTILES)}
        return xarray.Dataset(springs | {"trusted": trusted}, coords=coordinates)

    def plot(self) -> Any:
        """Draw median and 90 % interval of each spring over nominal over time.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes, shape (3,)

        Raises
        ------
        InputError
            If there is no posterior.
        """
        if not self.posteriors:
            raise InputError(f"{self!r} has no posterior to draw")
        pyplot = require("matplotlib.pyplot")
        times = np.array([each.message.time_ns for each in self.posteriors], dtype="datetime64[ns]")
        quantiles = self._quantiles()
        _, axes = pyplot.subplots(len(SPRINGS), sharex=True, figsize=(9, 6))
        for number, axis in enumerate(axes):
            low, median, high = quantiles[:, :, number].T
            axis.errorbar(times, median, yerr=[median - low, high - median], fmt="o", capsize=2)
            axis.set_ylabel(f"{SPRINGS[number]} / nominal")
        axes[0].set_title(f"{self.turbine}: median and 90 % interval")
        return axes

    def _quantiles(self) -> FloatArray:
        """(n_posteriors, 3 quantiles, 3 springs) over nominal [-]."""
        found = [each.quantiles for each in self.posteriors]
        return np.array(found).reshape(-1, len(QUANTILES), len(SPRINGS))


def open_session(path: str | os.PathLike[str], turbine: str | None = None) -> Session:
    """Open a recording with the results that it holds.

    Parameters
    ----------
    path : str or path
        An MCAP file, such as `out/session.mcap`, or a session's folder, earlier starts of the
        session included.
    turbine : str, optional
        Id of the turbine; the first one in the recording by default.

    Returns
    -------
    Session

    Raises
    ------
    InputError
        If it is no recording, or has nothing of the turbine.
    """
    from pipeline.sources.session_files import session_files, session_messages

    file = Path(path)
    kinds = (SensorLayout, ModalEstimate, WindowRejected, FoundationPosterior, FoundationEvent)
    files = session_files(file)
    messages = list(session_messages(files, kinds))
    known = {message.turbine: None for message in messages}  # in the order of the recording
    if not known or (turbine is not None and turbine not in known):  # blocks without a layout
        known |= {block.turbine: None for block in session_messages(files, (AccelerationBlock,))}
    name = next(iter(known), "") if turbine is None else turbine
    if known and name not in known:
        raise InputError(f"{file} has no turbine {name!r}; it has {', '.join(known)}")
    ours = [message for message in messages if message.turbine == name]
    layouts = [message for message in ours if isinstance(message, SensorLayout)]
    estimates = tuple(message for message in ours if isinstance(message, ModalEstimate))
    rejected = tuple(message for message in ours if isinstance(message, WindowRejected))
    posteriors = tuple(
        Posterior(message, np.array([each.nominal for each in message.parameters[:3]]))
        for message in ours
        if isinstance(message, FoundationPosterior)
    )
    events = tuple(message for message in ours if isinstance(message, FoundationEvent))
    layout = _places(layouts, estimates)
    channels = estimates[-1].channels if estimates else (layout.channel_names if layout else ())
    return Session(file, name, Modes(estimates, rejected, channels, layout), posteriors, events)


def _places(
    layouts: Sequence[SensorLayout], estimates: Sequence[ModalEstimate]
) -> SensorLayout | None:
    """Where the channels of the last estimate are; without any, all that the units have."""
    if not layouts:
        return None
    newest = {layout.unit: layout for layout in layouts}
    joined = joined_layout([newest[unit] for unit in sorted(newest)])
    if not estimates:
        return joined
    own = [layout for layout in layouts if layout.layout_id == estimates[-1].layout_id]
    found = own[-1] if own else joined
    return found if found.channel_names == estimates[-1].channels else None
