"""Which modes the sensors can see, and what they are called."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.full_model_modes import VISIBLE_SHARE, FullModes, solved_modes
from sensors.structure.description import Direction, ReferenceMode
from sensors.structure.foundation import TurbineError
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import StructuralModel

REFERENCE_WINDOW = 0.05  # a published mode is looked for within this relative distance [-]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceModes:
    """The labelled modes at one θ that a ModalModel follows to other foundations."""

    theta: FloatArray
    """Theta, (3,) [N/m, N·m/rad, N/rad]."""

    labels: tuple[str, ...]
    directions: tuple[Direction, ...]
    blade_energy_share: FloatArray
    """Blade energy share, (n_modes,) [-]."""

    vectors: FloatArray
    """Mass-normalised modes, (n_dofs, n_modes)."""

    def take(self, indices: Sequence[int]) -> "ReferenceModes":
        """Some of the modes, in the given order."""
        return ReferenceModes(
            theta=self.theta,
            labels=tuple(self.labels[i] for i in indices),
            directions=tuple(self.directions[i] for i in indices),
            blade_energy_share=self.blade_energy_share[list(indices)],
            vectors=self.vectors[:, list(indices)],
        )


def visible_modes(
    model: StructuralModel, layout: SensorLayout, *, highest_frequency: float
) -> ReferenceModes:
    """Return the modes that the sensors can see, labelled.

    Visible is a mode up to the highest frequency [Hz] whose largest displacement at a sensor, at
    unit modal mass, reaches VISIBLE_SHARE of the largest of all modes. First the description's
    reference modes under their own names, then the others, numbered on by frequency.
    """
    observation = ChannelReadings.of(model, layout)
    modes = solved_modes(model, observation, highest_frequency=highest_frequency)
    largest = modes.sensor_motion.max(initial=0.0)
    visible = np.flatnonzero(modes.sensor_motion >= VISIBLE_SHARE * largest).tolist()
    published = _published_modes(model.description.reference_modes, modes)
    listed = {name: mode for name, mode in published.items() if mode in visible}
    others = [mode for mode in visible if mode not in listed.values()]
    labels = [*listed, *_further_labels(set(published), len(others))]
    indices = [*listed.values(), *others]
    return ReferenceModes(
        theta=model.theta,
        labels=tuple(labels),
        directions=tuple(modes.directions[i] for i in indices),
        blade_energy_share=modes.blade_energy_share[indices],
        vectors=modes.vectors[:, indices],
    )


def _published_modes(listed: Iterable[ReferenceMode], modes: FullModes) -> dict[str, int]:
    """Name → index of the mode that a publication lists.

    It moves in the listed direction, lies near the listed frequency, and of those that do, the
    tower takes the largest part in it. (By frequency alone, blade modes with hardly any tower in
    them would be taken for modes 8 and 10 of the IEA 15 MW.)
    """
    found: dict[str, int] = {}
    for mode in listed:
        candidates = _near(mode, modes, taken=found.values())
        found[mode.name] = min(candidates, key=lambda i: modes.blade_energy_share[i])
    return found


def _near(mode: ReferenceMode, modes: FullModes, *, taken: Iterable[int]) -> list[int]:
    """Modes of the right direction within REFERENCE_WINDOW, doubled until there is one."""
    possible = [
        i
        for i, direction in enumerate(modes.directions)
        if direction == mode.direction and i not in taken
    ]
    if not possible:
        raise TurbineError(
            f"reference mode {mode.name!r} ({mode.direction}, {mode.frequency:g} Hz): the model "
            f"has no further {mode.direction} mode below the highest frequency asked; leave "
            "reference_modes out where no publication lists them"
        )
    distance = {i: abs(modes.frequencies[i] / mode.frequency - 1) for i in possible}
    window = REFERENCE_WINDOW
    while min(distance.values()) > window:
        window *= 2
    return [i for i in possible if distance[i] <= window]


def _further_labels(used: set[str], count: int) -> list[str]:
    """Return numbers that continue the listed names: '12', '13', …."""
    numbers = (str(number) for number in range(len(used) + 1, len(used) + count + 2 + len(used)))
    return [number for number in numbers if number not in used][:count]
