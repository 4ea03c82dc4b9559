"""Simulated hours with a known foundation, identified blind: what the recovery benchmark updates.

Identified windows can be kept on disk, since they cost ten times what a variant of the updating
does.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.messages import Message, ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.reader import read_messages
from pipeline.recording.writer import Recorder
from pipeline.updating.prior import Prior
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.arrays import FloatArray
from sensors.loads import BroadbandLoad, WaveBandLoad
from sensors.simulation.tower import SimulatedTower, SimulationSettings
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import SpringSign

Window = ModalEstimate | WindowRejected

LOWEST, HIGHEST = 0.8, 1.25  # true stiffness / nominal [-]
LOADS = {  # rms forces [N]: broadband on tower and a blade, waves fore-aft and side-side
    "strong": (50e3, 15e3, 300e3, 60e3),
    "weak": (20e3, 0.0, 1e6, 2e5),
}
LAYOUT = biaxial_layout(
    "bench", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
TUBE_REFINEMENT = {"exact": 1}  # elements in each of the updater's; 2 elsewhere


@dataclass(frozen=True, slots=True)
class Case:
    """One run. The loads, the noise and the true stiffness are the seed's."""

    seed: int
    windows: int
    load: str = "strong"
    sign: SpringSign = "published"
    structure: str = "finer"  # one of STRUCTURES

    @property
    def name(self) -> str:
        """Of a file."""
        return f"{self.structure}-{self.sign}-{self.load}-{self.windows}-{self.seed}"


def described(sign: SpringSign) -> TurbineDescription:
    """The turbine that the updater knows, with that sign convention of k12."""
    return load_turbine("iea15mw_monopile").with_sign(sign)


def _same(known: TurbineDescription) -> TurbineDescription:
    return known


def _flooded(known: TurbineDescription) -> TurbineDescription:
    assert known.water is not None
    return replace(known, water=replace(known.water, inside=True))


def _with_distributed_blades(known: TurbineDescription) -> TurbineDescription:
    return replace(known, blades=load_turbine("iea15mw_detailed").blades)


def _detailed(known: TurbineDescription) -> TurbineDescription:
    return load_turbine("iea15mw_detailed").with_sign(known.foundation.sign)


STRUCTURES: dict[str, Callable[[TurbineDescription], TurbineDescription]] = {
    "exact": _same,  # the updater's own elements
    "finer": _same,  # twice the tube elements
    "inner-water": _flooded,  # to the sea's level
    "distributed-blades": _with_distributed_blades,  # 24 twisted elements instead of six means
    "detailed": _detailed,  # both, and a transition piece: the scenario `model-error`
}

SAME_STRUCTURES = ("exact", "finer")  # as the updater knows them


def true_ratios(seed: int) -> FloatArray:
    """(3,) drawn from the positive definite part of the box."""
    prior = Prior(load_turbine("iea15mw_monopile").nominal)
    generator = np.random.default_rng(seed)
    while True:
        ratios = generator.uniform(LOWEST, HIGHEST, 3)
        if prior.supports(ratios):
            return ratios


def simulated(case: Case, layout: SensorLayout = LAYOUT) -> SimulatedTower:
    """The tower of one case; iterate for its blocks."""
    tower, blade, fore_aft, side_side = LOADS[case.load]
    settings = SimulationSettings(
        duration=600.0 * case.windows,
        seed=case.seed,
        stiffness_ratios=tuple(true_ratios(case.seed)),
        broadband=BroadbandLoad(tower_rms=tower, blade_rms=blade),
        waves=WaveBandLoad(fore_aft_rms=fore_aft, side_side_rms=side_side),
        tube_refinement=TUBE_REFINEMENT.get(case.structure, 2),
    )
    return SimulatedTower(STRUCTURES[case.structure](described(case.sign)), layout, settings)


def identified(case: Case, layout: SensorLayout = LAYOUT) -> list[Window]:
    """Simulated and identified windows of one case."""
    node = IdentificationNode()
    answers = list(node.handle(layout))
    for block in simulated(case, layout):
        answers.extend(node.handle(block))
    return [each for each in answers if isinstance(each, ModalEstimate | WindowRejected)]


def kept(case: Case, folder: Path | None) -> list[Window]:
    """The windows of one case, read from the folder if they were put there before, else made and
    put there. None: made every time.

    A file is worth keeping only as long as the simulator and the identification stay as they are.
    """
    if folder is None:
        return identified(case)
    path = folder / f"{case.name}.mcap"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        _record(path, identified(case))
    return list(_windows(read_messages(path, (ModalEstimate, WindowRejected))))


def _record(path: Path, windows: list[Window]) -> None:
    recorder = Recorder(path, metadata={}, clock=None)
    for window in windows:
        recorder.handle(window)
    recorder.close()


def _windows(messages: Iterator[Message]) -> Iterator[Window]:
    for message in messages:
        assert isinstance(message, ModalEstimate | WindowRejected)
        yield message
