"""Which sensor is to blame: each is left out in turn.

A sensor that is metres off leads the fit into another valley, from which no descent tells what is
wrong with it. What the others read fits as ever as soon as its channels are left out, and no other
sensor's, so that a few fits tell whether any one sensor is to blame, and which.
"""

from dataclasses import dataclass

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.alternatives import LARGEST_COST
from pipeline.updating.structural.joint_fit import FEW_STARTS, JointFit
from pipeline.updating.structural.joint_model import JointPeak
from sensors.acquisition.layout import SensorLayout

LEAST_DROP = 25.0  # of the cost: 12 nats against some sixty faults tried
UNLIKE_COST = 9.0  # of a shape that is left out because it is not its partner's: as much as of a
# mode without a partner


@dataclass(frozen=True, slots=True, eq=False)
class BlamedSensor:
    """A sensor without which the other ones fit."""

    elevation: float
    """[m]"""
    channels: tuple[int, ...]
    peak: JointPeak
    """Of the evidence without them."""


def blamed_sensor(fit: JointFit, evidence: ModalEvidence, peak: JointPeak) -> BlamedSensor | None:
    """The sensor without which the others fit best; None where they fit without none.

    peak   of the evidence with all sensors
    """
    best: BlamedSensor | None = None
    good = fit.settings.good_cost
    for elevation, channels in channels_at(fit.model.layout).items():
        end = fit.best(evidence.without_channels(channels), [peak.u], most_starts=FEW_STARTS)
        if end is not None and (best is None or misfit(end) < misfit(best.peak)):
            best = BlamedSensor(elevation, channels, end)
            if end.relative_cost <= good < LARGEST_COST < peak.relative_cost:
                break  # no mistake: as long as another one is wrong, the others do not fit
    if best is None or best.peak.relative_cost > good:
        return None
    return best if misfit(best.peak) < misfit(peak) - LEAST_DROP else None


def channels_at(layout: SensorLayout) -> dict[float, tuple[int, ...]]:
    """Numbers of the channels by their elevation [m]: of one sensor."""
    found: dict[float, tuple[int, ...]] = {}
    for number, channel in enumerate(layout.channels):
        found[channel.elevation] = (*found.get(channel.elevation, ()), number)
    return found


def misfit(peak: JointPeak) -> float:
    """The cost beyond chance, by which fits with and without a fault are compared: a shape that is
    left out must not count as one that fits."""
    return peak.excess + UNLIKE_COST * peak.comparison.unlike_shapes
