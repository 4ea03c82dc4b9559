"""Compute the model's modes at one foundation stiffness, and the nearest to identified ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.scenario import DEFAULT_SCENARIO, load_scenario
from pipeline.state.run_modes import CombinedMode
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.dynamics.modal_model import ModalModel, ModalParameters
from sensors.errors import InputError
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import SpringSign

SENSOR_SHARES = tuple(z / 145.0 for z in (41.0, 80.0, 106.0, 145.0))  # of the tower's height [-]


@dataclass(frozen=True, slots=True, eq=False)
class ModelModes:
    """The modes of a turbine that its sensors measure, at one stiffness."""

    model: ModalModel
    modes: ModalParameters
    ratios: NDArray[np.float64]
    """k11, k22, k12 over nominal, shape (3,) [-]."""

    @property
    def published(self) -> dict[str, float]:
        """Mode label → frequency that the publication lists [Hz]."""
        return {mode.name: mode.frequency for mode in self.model.description.reference_modes}

    def as_json(self) -> list[dict[str, Any]]:
        """Return the entries of `modes --json`, Table 1's modes first."""
        return [
            {
                "name": label,
                "direction": self.model.directions[number],
                "frequency_hz": float(self.modes.frequencies[0, number]),
                "shape": self.modes.shapes[0, number].tolist(),
                "blade_energy_share": float(self.model.blade_energy_share[number]),
                "table1_hz": self.published.get(label),
            }
            for number, label in enumerate(self.model.labels)
        ]


def model_modes(
    *,
    theta: str | None = None,
    sign: str | None = None,
    turbine: str | None = None,
    scenario: str | None = None,
) -> ModelModes:
    """Compute the modes of a turbine at the sensors of a scenario.

    Parameters
    ----------
    theta : str | None, optional
        "k11,k22,k12" as ratios to nominal; None: nominal.
    sign : str | None, optional
        "published" or "embedded-pile"; None: the scenario's.
    turbine : str | None, optional
        Shipped name or path of a description; None: the scenario's. Without a scenario it has
        accelerometers at the shipped ones' shares of its height.
    scenario : str | None, optional
        Shipped name or path; None: the default one.

    Raises
    ------
    InputError
        If one of them is wrong, or the springs are not positive definite.
    """
    chosen = load_scenario(scenario or DEFAULT_SCENARIO)
    description = chosen.structure if turbine is None else load_turbine(turbine)
    if sign is not None:
        if sign not in get_args(SpringSign):
            words = " or ".join(get_args(SpringSign))
            raise InputError(f"--sign {sign!r} is not a sign convention: {words}")
        description = description.with_sign(sign)  # type: ignore[arg-type]  # checked above
    layout = replace(chosen.layout, turbine=description.name)
    if (
        turbine is not None and scenario is None
    ):  # sensors of one's own scenario stay where they are
        layout = default_layout(description)
    model = ModalModel(description, layout)
    ratios = _ratios(theta)
    modes = model.modal((ratios * model.nominal)[None])
    if not modes.admissible[0]:
        raise InputError(
            f"--theta {theta}: no foundation can be so: k11·k22 must exceed k12² "
            f"(nominal k12²/(k11·k22) is {_coupling(model.nominal):.3f}, here "
            f"{_coupling(ratios * model.nominal):.3f}) and the structure must stand under gravity"
        )
    return ModelModes(model, modes, ratios)


def default_layout(description: TurbineDescription) -> SensorLayout:
    """Bi-axial accelerometers on a structure of which no sensors are known.

    Parameters
    ----------
    description : TurbineDescription
        The structure; on the shipped tower they are where the shipped scenario has them.

    Returns
    -------
    SensorLayout
        At the same shares of the height above mean water level.
    """
    elevations = tuple(round(share * description.tower_top, 6) for share in SENSOR_SHARES)
    return biaxial_layout("tower-1", turbine=description.name, unit="tower", elevations=elevations)


@dataclass(frozen=True, slots=True)
class NearestMode:
    """The model's mode nearest in frequency to an identified one, at the nominal foundation."""

    identified: CombinedMode
    label: str
    frequency: float
    """Frequency of the model's mode [Hz]."""
    mac: float
    """MAC of both shapes [-]; NaN where the sensors differ from the model's."""


def nearest_modes(
    modes: Sequence[CombinedMode],
    structure: TurbineDescription,
    layout: SensorLayout,
    channels: Sequence[str],
) -> list[NearestMode]:
    """Return the nearest mode of a structure to each identified mode.

    Of use where no modes are paired, so that there is no posterior.

    Parameters
    ----------
    modes : sequence of CombinedMode
        As identified.
    structure : TurbineDescription
        Whose modes are looked up, at its nominal foundation.
    layout : SensorLayout
        Of the sensors that measured.
    channels : sequence of str
        Of the shapes' components, in their order.
    """
    model = ModalModel(structure, layout)
    at_nominal = model.modal(model.nominal[None])
    frequencies, shapes = at_nominal.frequencies[0], at_nominal.shapes[0]
    names = [channel.name for channel in layout.channels]
    places = [names.index(name) for name in channels if name in names]
    found = []
    for mode in modes:
        nearest = int(np.argmin(np.abs(np.log(frequencies / mode.frequency))))
        mac = float("nan")
        if len(mode.shape) == len(places):
            model_shape = shapes[[nearest]][:, places]
            mac = modal_assurance_criterion(np.array([mode.shape]), model_shape)[0, 0]
        label = model.labels[nearest]
        found.append(NearestMode(mode, label, float(frequencies[nearest]), float(mac)))
    return found


def _coupling(stiffness: NDArray[np.float64]) -> float:
    k11, k22, k12 = stiffness
    return float(k12**2 / (k11 * k22))


def _ratios(theta: str | None) -> NDArray[np.float64]:
    if theta is None:
        return np.ones(3)
    try:
        ratios = np.array([float(part) for part in theta.split(",")])
    except ValueError:
        ratios = np.array([])
    if ratios.shape != (3,) or not np.all(np.isfinite(ratios)):
        raise InputError(
            f"--theta {theta!r}: three numbers are needed, k11,k22,k12 as ratios to nominal, "
            "e.g. 1,0.9,1"
        )
    if not np.all(ratios[:2] > 0):
        raise InputError(f"--theta {theta!r}: k11 and k22 must be above 0")
    return ratios
