"""A sensor that is turned, swapped, flipped, scaled or displaced: found by fitting each in turn.

Each fault is one more model of the same data. A turned, scaled or displaced sensor is the fit with
a prior of that one figure that allows it; a flipped or swapped one the fit to shapes whose channels
are put right, or to those of the other sensors, where nothing else explains what one reads; sensors
that are all turned by one angle (`turned_layouts`), as against a nacelle whose yaw nothing reports,
the fit with all headings about that angle. The cheapest is taken where it lowers the cost by more
than chance and the number of faults that were tried allow.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from pipeline.updating.acceptance import AcceptanceSettings
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import LARGEST_COST, JointFit
from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.sensors.figures import SensorFigure
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

WIDE = {"gain": 40.0, "heading": 30.0, "height": 60.0}  # factor on the prior's std of a fault
EXCHANGES_TRIED = 3  # of channels, those that pair the modes best
MUCH_NEARER = 0.7  # of the pairing cost as it is, below which wrong cables are likely: flips and
# swaps leave .07 to .6 of it, other faults .85 and more (tests.benchmarks.structural_uncertainty,
# seeds 208001 to 208035)
LEAST_DROP = 25.0  # of the cost: 12 nats against some sixty faults tried
FIGURES_TRIED = 5  # of sensors, those whose freedom promises most where the fit ended
CORRECTIONS_TRIED = 4  # flips and swaps, those that fit best where the fit without a fault ended
SUSPICIOUS_SHAPES = 1.35  # χ² per shape component at which faults are looked for
MOST_OF_A_SHAPE = 25.0  # of that χ²: a sensor's fault shows in every mode, a mixture in one
MIXED_SHARE = AcceptanceSettings.unpredicted_share  # of the modes, for which none is left out [-]
SUSPICIOUS_COST = 1.5  # per degree of freedom, likewise
SUSPICIOUS_PAIRS = 0.85  # share of modes with a partner, below which likewise [-]
SUSPICIOUS_FIGURE = 3.0  # of a sensor's figure from its prior, likewise [std]
SUSPICIOUS_UNLIKE = 0.25  # share of the shapes that are not their partners', likewise; drawn towers
# have at most .12 (tests.benchmarks.structural_uncertainty, seeds 19000 to 19013)
LOST_PAIRS = 0.02  # share of the modes that may lose their partner by a fault's correction [-]
STARTS = {"gain": (0.0,), "heading": (0.0,), "height": (0.0, 2.5, -2.5)}  # of the descent to a
# fault, in its unit: beyond a metre modes seem to be others, and no step from 0 lowers the cost
# (the same, seeds 208000 to 208011)
ALL_TURNED = "heading of all sensors"
LEAST_SIZE = {"gain": 0.03, "heading": 5.0, "height": 0.7}  # that is named [-], [deg], [m]


@dataclass(frozen=True, slots=True, eq=False)
class SensorFault:
    """What is wrong with one sensor, or with two."""

    name: str
    """ "heading 80 m", "flipped z80-fa", "swapped 80 106", "exchanged z80-fa z80-ss" """
    text: str
    """ "the sensor at 80 m is turned by 14°" """
    fit: JointFit
    """With a prior that allows it."""
    order: tuple[int, ...]
    """Which channel's values each channel of the layout really has."""
    signs: tuple[float, ...]
    places: tuple[int, ...] = ()
    """Of the coordinates that are far off, all by the same; none where channels are confused."""
    left_out: tuple[int, ...] = ()
    """Channels that are not compared: nothing explains what they read."""

    def size(self, u: FloatArray) -> float:
        """Of the coordinates that are far off, at a point [prior standard deviations]."""
        return float(np.mean(u[list(self.places)])) if self.places else 0.0

    def corrected(self, evidence: ModalEvidence) -> ModalEvidence:
        """The evidence with the channels put right."""
        if self.left_out:
            return evidence.without_channels(self.left_out)
        return evidence.with_channels(self.order, self.signs)

    def undone(self, corrected: ModalEvidence) -> ModalEvidence:
        """The evidence as it came: flipping or exchanging twice changes nothing."""
        return self.corrected(corrected)


def suspicious(fit: JointFit, peak: JointPeak) -> bool:
    """Whether shapes or sensors' figures call for a search."""
    found = peak.comparison
    shapes = ~found.is_frequency
    if peak.relative_cost > SUSPICIOUS_COST or found.pairing.paired_share < SUSPICIOUS_PAIRS:
        return True
    if found.unlike_share > SUSPICIOUS_UNLIKE:
        return True
    if not shapes.any():
        return False
    misfit = float(np.minimum(_of_shapes(fit, peak), MOST_OF_A_SHAPE).sum() / shapes.sum())
    z = fit.coordinates.sensors(peak.u)
    return misfit > SUSPICIOUS_SHAPES or float(np.abs(z).max(initial=0.0)) > SUSPICIOUS_FIGURE


def _of_shapes(fit: JointFit, peak: JointPeak) -> FloatArray:
    """χ² of each mode's shape at a peak."""
    found = peak.comparison
    shapes = ~found.is_frequency
    squares = found.errors[shapes] ** 2 / fit.variances(found, 0.0)[shapes]
    return np.asarray(np.bincount(found.groups[shapes], weights=squares), dtype=np.float64)


def _of_sensors(fit: JointFit, peak: JointPeak) -> float:
    """The misfit without what single shapes have beyond what counts of one."""
    beyond = np.maximum(_of_shapes(fit, peak) - MOST_OF_A_SHAPE, 0.0)
    return peak.misfit - float(beyond.sum())


def sensor_fault(
    fit: JointFit, evidence: ModalEvidence, peak: JointPeak, *, last: str = ""
) -> tuple[SensorFault, JointPeak] | None:
    """The likeliest fault and the peak with it; None where none explains enough.

    Parameters
    ----------
    fit : JointFit
        Of one alternative.
    evidence : ModalEvidence
        Of all windows.
    peak : JointPeak
        Without a fault.
    last : str, optional
        Name of the fault that the last refresh found: while it explains the data, no other is
        looked for.
    """
    figures, corrections = _likeliest_figures(fit, peak), list(_wrong_cables(fit))
    known = fault_named(last, fit)
    found = _best_of([known] if known else [], evidence, peak)
    if found is None:
        corrections.sort(key=lambda each: fit.cost_at(each.corrected(evidence), peak.u))
        likely = [*corrections[:CORRECTIONS_TRIED], *_best_paired(_exchanges(fit), fit, evidence)]
        found = _best_of([*figures, *likely], evidence, peak)
    return found


def fault_named(name: str, fit: JointFit, *, size: float = 0.0) -> SensorFault | None:
    """The fault of that name with this fit; None where the layout has no such sensor.

    Parameters
    ----------
    name : str
        Of the fault.
    fit : JointFit
        Of one alternative.
    size : float, optional
        Of a figure, about which it is looked for [prior standard deviations].
    """
    figures = chain(_wrong_figures(fit, size), _turned_layouts(fit, size))
    faults = chain(figures, _wrong_cables(fit), _exchanges(fit), _left_out(fit))
    return next((each for each in faults if each.name == name), None)


def still_explained(
    fault: SensorFault, fit: JointFit, measured: ModalEvidence, peak: JointPeak
) -> SensorFault | None:
    """The fault with its size in words, while the evidence needs it; else None.

    Parameters
    ----------
    fault : SensorFault
        As the last refresh found it.
    fit : JointFit
        Without the fault.
    measured : ModalEvidence
        At the model's water level, channels as they came.
    peak : JointPeak
        With the fault.
    """
    if peak.relative_cost > LARGEST_COST:
        return None
    without = fit.settled(measured, peak.u)
    if without is not None and without.misfit < peak.misfit + LEAST_DROP:
        return None
    if without is not None and fault.left_out:
        mixed = MIXED_SHARE * np.unique(without.comparison.groups).size * MOST_OF_A_SHAPE
        if _of_sensors(fit, without) < _of_sensors(fault.fit, peak) + LEAST_DROP + mixed:
            return None  # that a few modes are mixed: less of them is compared without the sensor
    text = _sized(fault, peak)
    return replace(fault, text=text) if text else None


def likely_wirings(fit: JointFit, evidence: ModalEvidence) -> list[SensorFault]:
    """Sensors swapped, a channel flipped or two exchanged, with which modes find much nearer
    partners among drawn structures, the nearest first; none where none is much nearer."""
    return _best_paired([*_wrong_cables(fit), *_exchanges(fit)], fit, evidence, MUCH_NEARER)


def turned_by(fit: JointFit, angles: Iterable[float]) -> list[tuple[SensorFault, float]]:
    """All sensors turned by each of some angles [deg], with it in prior standard deviations."""
    fault = fault_named(ALL_TURNED, fit)
    if fault is None:
        return []
    std = next(figure.std for figure in fit.sensors.figures if figure.kind == "heading")
    return [(fault, angle / std) for angle in angles if abs(angle) >= LEAST_SIZE["heading"]]


def fault_of_sensor(
    fit: JointFit, evidence: ModalEvidence, channels: Collection[int], without: JointPeak
) -> tuple[SensorFault, JointPeak]:
    """What is wrong with a sensor without which the other ones fit, and the peak with it.

    Parameters
    ----------
    fit : JointFit
        Of one alternative.
    evidence : ModalEvidence
        Of all windows.
    channels : collection of int
        Of the sensor.
    without : JointPeak
        The peak of the evidence without them.

    Notes
    -----
    All else is known from the other sensors, so that one that is metres off is a descent away.
    Where no fault explains what it reads, it is left out.
    """
    here, u = set(channels), without.u
    figures = [each for each in _wrong_figures(fit) if here >= set(_figure(each).channels)]
    cables = [*_wrong_cables(fit), *_exchanges(fit)]
    ends = (
        (fault, fault.fit.settled(evidence, start))
        for fault, start in _by_what_is_read(figures, fit, evidence, u)
    )
    recabled = (
        (fault, fit.settled(fault.corrected(evidence), u))
        for fault in cables
        if here >= set(_changed(fault))
    )
    best: tuple[SensorFault, JointPeak] | None = None
    for fault, end in chain(ends, recabled):
        if end is None or not _sized(fault, end):
            continue
        if best is None or end.misfit < best[1].misfit:
            best = (replace(fault, text=_sized(fault, end)), end)
        if best[1].misfit <= without.misfit + LEAST_DROP:
            return best  # as much as leaving it out explains
    if best is not None and best[1].relative_cost <= SUSPICIOUS_COST:
        return best
    alone = next(each for each in _left_out(fit) if set(each.left_out) == here)
    return alone, without


def _by_what_is_read(
    figures: Sequence[SensorFault], fit: JointFit, evidence: ModalEvidence, u: FloatArray
) -> list[tuple[SensorFault, FloatArray]]:
    """Faults of one figure with the point where its size explains most of the shapes, all else as
    at u; the one that explains most first.

    Of shapes that are e off and change by j with a figure, the size −jᵀ D⁻¹ e / jᵀ D⁻¹ j leaves
    least of Σ (e + j size)² / D.
    """
    found = fit.compared(evidence, fit.targets(evidence), u, fit.tolerance)
    if found is None:
        return []
    rows = ~found.is_frequency
    e, D = found.errors[rows], fit.variances(found, 0.0)[rows]
    sized = []
    for fault in figures:
        j = found.jacobian[rows, fault.places[0]]
        size = -float((j / D) @ e / ((j / D) @ j + 1e-12))
        start = u.copy()
        start[fault.places[0]] += size
        sized.append((float(((e + j * size) ** 2 / D).sum()), fault, start))
    return [(fault, start) for _, fault, start in sorted(sized, key=lambda each: each[0])]


def _best_of(
    faults: Sequence[SensorFault], evidence: ModalEvidence, peak: JointPeak
) -> tuple[SensorFault, JointPeak] | None:
    best: tuple[SensorFault, JointPeak] | None = None
    for fault in faults:
        fitted = _fitted(fault, evidence, peak)
        if fitted is None or _share(fitted) < _share(peak) - LOST_PAIRS:
            continue  # a mode without a partner is cheaper than one with a poor shape
        if best is None or fitted.misfit < best[1].misfit:
            best = (fault, fitted)
    if best is None or best[1].misfit > peak.misfit - LEAST_DROP:
        return None
    fault, end = best
    text = _sized(fault, end) if end.relative_cost <= LARGEST_COST else ""
    return (replace(fault, text=text), end) if text else None


def _share(peak: JointPeak) -> float:
    """Of the identified modes that have a partner."""
    return peak.comparison.pairing.paired_share


def _fitted(fault: SensorFault, evidence: ModalEvidence, peak: JointPeak) -> JointPeak | None:
    """The peak with a fault: near the one without it, unless channels change their meaning."""
    if not fault.places:
        return fault.fit.best(fault.corrected(evidence), [peak.u], most_starts=2)
    ends = [fault.fit.settled(evidence, start) for start in _starts(fault, peak.u)]
    return min((end for end in ends if end), key=lambda end: end.misfit, default=None)


def _starts(fault: SensorFault, u: FloatArray) -> Iterator[FloatArray]:
    """Points with one sensor's figure off by some typical sizes, else as at u."""
    figure = next(each for each in fault.fit.sensors.figures if each.name == fault.name)
    for size in STARTS[figure.kind]:
        start = u.copy()
        start[list(fault.places)] += size / figure.std
        yield start


def _wrong_figures(fit: JointFit, size: float = 0.0) -> Iterator[SensorFault]:
    """One gain, heading or height that is far off."""
    n = len(fit.model.layout.channels)
    order, signs = tuple(range(n)), (1.0,) * n
    first = fit.coordinates.n_dim - len(fit.sensors.figures)
    for number, figure in enumerate(fit.sensors.figures):
        place = first + number
        loosened = fit.with_prior(place, size, WIDE[figure.kind])
        yield SensorFault(figure.name, figure.name, loosened, order, signs, (place,))


def _turned_layouts(fit: JointFit, size: float) -> Iterator[SensorFault]:
    """All sensors turned by one angle, each off by its own heading beside it.

    size   of the angle [prior standard deviations of a heading]
    """
    first = fit.coordinates.n_dim - len(fit.sensors.figures)
    kinds = [figure.kind for figure in fit.sensors.figures]
    places = tuple(first + n for n, kind in enumerate(kinds) if kind == "heading")
    if not places:
        return
    turned = fit
    for place in places:
        turned = turned.with_prior(place, size, 1.0)
    n = len(fit.model.layout.channels)
    yield SensorFault(ALL_TURNED, ALL_TURNED, turned, tuple(range(n)), (1.0,) * n, places)


def _wrong_cables(fit: JointFit) -> Iterator[SensorFault]:
    """One channel flipped, or two sensors swapped."""
    layout: SensorLayout = fit.model.layout
    n = len(layout.channels)
    order = tuple(range(n))
    for channel in range(n):
        flipped = tuple(-1.0 if c == channel else 1.0 for c in range(n))
        name = layout.channels[channel].name
        yield SensorFault(f"flipped {name}", f"channel {name} is flipped", fit, order, flipped)
    elevations = sorted({channel.elevation for channel in layout.channels})
    for low, high in combinations(elevations, 2):
        here = [c for c in range(n) if layout.channels[c].elevation == low]
        there = [c for c in range(n) if layout.channels[c].elevation == high]
        if len(here) == len(there):
            swapped = list(order)
            for a, b in zip(here, there, strict=True):
                swapped[a], swapped[b] = b, a
            text = f"the sensors at {low:g} m and {high:g} m are swapped"
            yield SensorFault(f"swapped {low:g} {high:g}", text, fit, tuple(swapped), (1.0,) * n)


def _exchanges(fit: JointFit) -> Iterator[SensorFault]:
    """Any two channels whose cables are exchanged."""
    layout: SensorLayout = fit.model.layout
    n = len(layout.channels)
    for one, other in combinations(range(n), 2):
        order = list(range(n))
        order[one], order[other] = other, one
        first, second = layout.channels[one].name, layout.channels[other].name
        text = f"channels {first} and {second} are exchanged"
        name = f"exchanged {first} {second}"
        yield SensorFault(name, text, fit, tuple(order), (1.0,) * n)


def _left_out(fit: JointFit) -> Iterator[SensorFault]:
    """Any sensor whose channels are not compared."""
    n = len(fit.model.layout.channels)
    layout: SensorLayout = fit.model.layout
    for elevation in np.unique(layout.elevations):
        channels = tuple(np.flatnonzero(layout.elevations == elevation).tolist())
        text = f"no height, direction or gain of the sensor at {elevation:g} m explains its shapes"
        name = f"left out {elevation:g} m"
        yield SensorFault(name, text, fit, tuple(range(n)), (1.0,) * n, left_out=channels)


def _changed(fault: SensorFault) -> list[int]:
    """Channels that a fault of cables exchanges or flips."""
    pairs = enumerate(zip(fault.order, fault.signs, strict=True))
    return [c for c, (other, sign) in pairs if other != c or sign < 0]


def _figure(fault: SensorFault) -> SensorFigure:
    """Of a fault of one gain, heading or height."""
    first = fault.fit.coordinates.n_dim - len(fault.fit.sensors.figures)
    return fault.fit.sensors.figures[fault.places[0] - first]


def _likeliest_figures(fit: JointFit, peak: JointPeak) -> list[SensorFault]:
    """The figures whose freedom would lower the cost by most, as the curvature at a peak says.

    With h the posterior's variance of a figure that lies z from its prior's mean, in prior standard
    deviations, a flat prior of it lowers the cost by z² / (1 − h).
    """
    faults = list(_wrong_figures(fit))
    first = fit.coordinates.n_dim - len(faults)
    places = np.arange(first, fit.coordinates.n_dim)
    D, J = fit.variances(peak.comparison, 0.0), peak.comparison.jacobian
    covariance = np.linalg.inv((J.T / D) @ J + fit.coordinates.prior_precision)
    variances = np.minimum(np.diag(covariance)[places], 1 - 1e-6)
    drops = (peak.u - fit.coordinates.origin)[places] ** 2 / (1 - variances)
    return [faults[number] for number in np.argsort(-drops)[:FIGURES_TRIED]]


def _best_paired(
    faults: Iterable[SensorFault], fit: JointFit, evidence: ModalEvidence, share: float = 1.0
) -> list[SensorFault]:
    """Those with which modes find nearer partners among drawn structures, the nearest first.

    share   of the pairing cost as it is, below which that is so
    """
    as_it_is = fit.pairing_bound(fit.targets(evidence))
    bounds = [(fit.pairing_bound(fit.targets(each.corrected(evidence))), each) for each in faults]
    better = [each for each in bounds if each[0] < share * as_it_is]
    return [fault for _, fault in sorted(better, key=lambda each: each[0])][:EXCHANGES_TRIED]


def _sized(fault: SensorFault, peak: JointPeak) -> str:
    """The fault in words with its size; "" for one that is too small to be one."""
    if not fault.places:
        return fault.text
    figure = _figure(fault)
    size = fault.size(peak.u) * figure.std
    if abs(size) < LEAST_SIZE[figure.kind]:
        return ""
    if fault.name == ALL_TURNED:
        return (
            f"all sensors are turned by {size:.0f}° against the nacelle's axes: its yaw, or the "
            "layout's directions"
        )
    if figure.kind == "gain":
        return f"channel {figure.target} reads {1 + size:.3g} of what it should"
    if figure.kind == "heading":
        return f"the sensor at {figure.target} is turned by {size:.0f}°"
    return f"the sensor at {figure.target} sits {size:+.1f} m off"
