"""Posterior of the foundation's springs from identified modes and a structure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.messages import FoundationEvent, FoundationPosterior, QualityWarning, WindowRejected
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, one_blas_thread

from .errors import InputError, require
from .modes import Modes, with_layout
from .structure import Structure, structure_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SPRINGS = ("k11", "k22", "k12")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Posterior:
    """k11, k22 and k12 given the identified modes, after the last window."""

    message: FoundationPosterior
    """As it is published and recorded: quantiles, pairs, diagnostics."""
    nominal: FloatArray
    """(3,) the description's k11 [N/m], k22 [N·m/rad], k12 [N/rad]."""
    rejected: tuple[WindowRejected, ...] = ()
    """Windows that did not enter, each with its reason."""
    events: tuple[FoundationEvent, ...] = ()
    """Changes of the structure that were noticed on the way."""

    @property
    def draws(self) -> FloatArray:
        """(n_draws, 3) draws of k11 [N/m], k22 [N·m/rad], k12 [N/rad]."""
        return np.asarray(self.message.draws[:, :3])

    @property
    def ratios(self) -> FloatArray:
        """(n_draws, 3) the draws over nominal [-]."""
        return self.draws / self.nominal

    @property
    def trusted(self) -> bool:
        """Whether nothing contradicts the posterior; see `warnings`."""
        return self.message.trusted

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What speaks against it, or limits it."""
        return self.message.warnings

    def __repr__(self) -> str:
        springs = ", ".join(
            f"{name} {median:.3f} ± {(high - low) / 2:.3f}"
            for name, (low, median, high) in zip(SPRINGS, self.quantiles.T, strict=True)
        )
        verdict = "trusted" if self.trusted else "NOT trusted"
        return (
            f"<Posterior: {springs} × nominal (90 %), {self.message.n_windows} windows, {verdict}>"
        )

    @property
    def quantiles(self) -> FloatArray:
        """5 %, 50 % and 95 % quantiles of k11, k22, k12 over nominal, shape (3, 3) [-]: of all the
        sampler's draws, of which `draws` has a thousand."""
        springs = [self.message.parameter(name) for name in SPRINGS]
        return np.array([[k.p05, k.median, k.p95] for k in springs]).T / [
            k.nominal for k in springs
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row a parameter: unit, nominal, median, 5 % and 95 % quantile."""
        pandas = require("pandas")
        summaries = (*self.message.parameters, *self.message.figures)
        names = ("name", "unit", "nominal", "median", "p05", "p95")
        rows = [{name: getattr(each, name) for name in names} for each in summaries]
        return pandas.DataFrame(rows).set_index("name")

    def to_xarray(self) -> xr.Dataset:
        """Return the draws of k11, k22 and k12 with the dimensions chain and draw."""
        xarray = require("xarray")
        variables = {
            name: (("chain", "draw"), self.draws[None, :, number])
            for number, name in enumerate(SPRINGS)
        }
        return xarray.Dataset(variables)

    def to_inference_data(self) -> Any:
        """Return the draws for arviz.

        Returns
        -------
        arviz.InferenceData or xarray.DataTree
            With the group `posterior`; which of the two depends on the arviz installed.
        """
        arviz = require("arviz")
        if hasattr(arviz, "convert_to_datatree"):  # arviz 1: a tree of xarray's own
            return arviz.convert_to_datatree(self.to_xarray())
        return arviz.convert_to_inference_data(self.to_xarray())

    def plot(self) -> Any:
        """Draw the corner plot of k11, k22 and k12 over nominal.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes, shape (3, 3)
        """
        pyplot = require("matplotlib.pyplot")
        _, axes = pyplot.subplots(3, 3, figsize=(7, 7), sharex="col")
        for row in range(3):
            for column in range(3):
                axis = axes[row, column]
                if column > row:
                    axis.set_axis_off()
                elif column == row:
                    axis.hist(self.ratios[:, row], bins=40, density=True, color="C0")
                    axis.set_yticks([])
                else:
                    axis.plot(self.ratios[:, column], self.ratios[:, row], ".", ms=2, alpha=0.4)
                if row == 2:
                    axis.set_xlabel(f"{SPRINGS[column]} / nominal")
                if 0 < column < row:
                    axis.tick_params(labelleft=False)
                if column == 0 and row > 0:
                    axis.set_ylabel(f"{SPRINGS[row]} / nominal")
        return axes


@one_blas_thread()
def update(
    modes: Modes,
    structure: Structure | str | os.PathLike[str] | None = None,
    *,
    layout: SensorLayout | None = None,
    exact: bool = False,
    scenario: str | os.PathLike[str] | None = None,
    seed: int | None = None,
) -> Posterior:
    """Infer the foundation's springs from identified modes, as a session does.

    Parameters
    ----------
    modes : Modes
        Of one or several windows; they must carry the places of their channels, or `layout` does.
    structure : Structure, str or path, optional
        The turbine, e.g. ``Structure("iea15mw_monopile")``; the scenario's by default. A structure
        is never assumed.
    layout : SensorLayout, optional
        Where the channels are.
    exact : bool
        True: every figure of the description is exact, as `uncertain = "exact"` in a scenario.
        By default masses, moduli, wall and added mass are inferred with the springs, within the
        same prior uncertainty as in a session.
    scenario : str or path, optional
        Shipped scenario, scenario file, or a recording (MCAP) that holds one: gives the settings of
        the updating, the seed and, where `structure` is left out, the structure.
    seed : int, optional
        Of the sampler; the scenario's, else 1.

    Returns
    -------
    Posterior
        After the last window that entered.

    Raises
    ------
    InputError
        If neither structure nor scenario is given, the places of the channels are not known, or no
        window could be used; the message has the last reason.
    """
    if not isinstance(modes, Modes):
        raise InputError(
            f"update takes identified modes, not {type(modes).__name__}: pw.identify(…) gives them"
        )
    if layout is not None:
        modes = with_layout(modes, layout)
    if modes.layout is None:
        raise InputError(
            "where the channels are is not known: give layout=…, or read the file with its layout"
        )
    chosen = chosen_scenario(scenario, exact=exact, seed=seed)
    if structure is None and scenario is None:
        raise InputError(
            "which structure is it? Give structure=pw.Structure(…) or scenario=…; none is assumed"
        )
    described = Structure(chosen.structure) if structure is None else structure_of(structure)
    answers = updated(modes.estimates, described, modes.layout, chosen)
    rejected = tuple(each for each in answers if isinstance(each, WindowRejected))
    posteriors = [each for each in answers if isinstance(each, FoundationPosterior)]
    if not posteriors:
        reasons = [each.reason for each in (*modes.rejected, *rejected)]
        raise InputError(f"no window could be used: {reasons[-1] if reasons else 'there is none'}")
    events = tuple(each for each in answers if isinstance(each, FoundationEvent))
    return Posterior(posteriors[-1], described.nominal, rejected, events)


if TYPE_CHECKING:
    from pipeline.messages import ModalEstimate
    from pipeline.nodes.operating_state import Answer
    from pipeline.scenario import Scenario


def chosen_scenario(
    scenario: str | os.PathLike[str] | None, *, exact: bool, seed: int | None
) -> Scenario:
    """Return the settings of an updating: a scenario's, or the defaults of one that sets nothing.

    Parameters
    ----------
    scenario : str, path or None
        Name, file, or a recording that holds one; None: the defaults.
    exact : bool
        Take the structure as exact.
    seed : int or None
        Of every random choice; None: the scenario's.

    Raises
    ------
    InputError
        If there is no such scenario, or the recording holds none.
    """
    from pipeline.scenario import load_scenario, scenario_from_text, with_overrides, with_structure
    from pipeline.sources.sources import replayed
    from pipeline.updating.structural.settings import StructureSettings

    if scenario is None:
        chosen = scenario_from_text("", "pilewatch.update")
    elif Path(scenario).suffix == ".mcap":
        chosen = replayed(Path(scenario)).scenario
    else:
        chosen = load_scenario(os.fspath(scenario))
    if exact:
        chosen = with_structure(chosen, StructureSettings(exact=True))
    return with_overrides(chosen, seed=seed)


def updated(
    estimates: Sequence[ModalEstimate],
    structure: Structure,
    layout: SensorLayout,
    scenario: Scenario,
) -> list[Answer]:
    """Every posterior, event and rejected window, in order, as a session of these gives them."""
    from pipeline.nodes.updating import TurbineUpdating
    from pipeline.updating.structural.inference import joint_inference
    from pipeline.updating.updater import FoundationUpdater

    settings, population = scenario.updating, scenario.population
    joint = joint_inference(
        structure.description, layout, settings, seed=scenario.seed, population=population
    )
    updater = FoundationUpdater(
        structure.model(layout),
        layout,
        settings,
        seed=scenario.seed,
        population=population,
        joint=joint,
    )
    node = TurbineUpdating(updater, layout, scenario.operation)
    return [answer for estimate in estimates for answer in node.handle(estimate)]
