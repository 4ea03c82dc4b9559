"""The modes of a whole session: one entry a track, combined over the windows that saw it."""

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.messages import FoundationPosterior, ModalEstimate, Mode, ModePair
from pipeline.modal_assurance import modal_assurance_criterion
from sensors.arrays import FloatArray
from sensors.bounded_dict import BoundedDict
from sensors.json_values import Json, known

MOST_WINDOWS_AHEAD = 20  # windows that the identification may be ahead of the updating


@dataclass(frozen=True, slots=True, eq=False)
class CombinedMode:
    """One mode over all windows that saw it."""

    name: str
    """The model's label where it was paired, else the track's name."""
    frequency: float
    """Precision-weighted mean over the windows [Hz]."""
    frequency_std: float
    """Of that mean [Hz]."""
    damping_ratio: float
    """Mean over the windows [-]."""
    damping_ratio_std: float
    """Standard deviation of that mean [-]."""
    shape: tuple[float, ...]
    """Of the window that saw it sharpest [-]."""
    seen_in_windows: int
    pair_id: str
    quality: float
    pair: ModePair | None = None
    """With a model mode."""
    channels: tuple[str, ...] = ()
    """Of the shape, in its order."""

    def as_json(self) -> Json:
        """Return the mode as `summary.json` has it."""
        return {
            "name": self.name,
            "frequency_hz": self.frequency,
            "frequency_std_hz": known(self.frequency_std),
            "damping_ratio": self.damping_ratio,
            "damping_ratio_std": known(self.damping_ratio_std),
            "shape": list(self.shape),
            "mac_to_model": None if self.pair is None else known(self.pair.mac),
            "model_frequency_hz": None if self.pair is None else known(self.pair.model_frequency),
            "seen_in_windows": self.seen_in_windows,
            "pair_id": self.pair_id or None,
            "quality": known(self.quality),
        }


@dataclass(frozen=True, slots=True, eq=False)
class SeenMode:
    """A mode, and the channels of its shape."""

    mode: Mode
    channels: tuple[str, ...]
    """Names, in the order of the shape's components."""

    def shape_at(self, channels: Sequence[str]) -> FloatArray:
        """Return the shape in the order of `channels`, which are the same ones."""
        return self.mode.shape[[self.channels.index(name) for name in channels]]


class CombinedTracks:
    """Sums over the windows that saw each track: as large after years as after a day.

    Parameters
    ----------
    estimates : iterable of ModalEstimate, optional
        The first windows.
    most : int or None, optional
        Tracks that are kept; of more the one that was not seen for longest goes. None: all.
    """

    def __init__(self, estimates: Iterable[ModalEstimate] = (), *, most: int | None = None) -> None:
        self._most = most
        self._tracks: dict[str, _Track] = {}  # by name, in the order in which they were first seen
        self._added = 0
        # end of a window [ns] → its channels, of those that a posterior may still answer
        self._channels = BoundedDict[int, tuple[str, ...]](MOST_WINDOWS_AHEAD)
        for estimate in estimates:
            self.add(estimate)

    def add(self, estimate: ModalEstimate) -> None:
        """Enter the modes of one more window."""
        self._added += 1
        self._channels.put(estimate.end_ns, estimate.channels)
        for number, mode in enumerate(estimate.modes):
            name = mode.name or f"window {estimate.window} mode {number + 1}"
            seen = SeenMode(mode, estimate.channels)
            if name not in self._tracks:
                self._tracks[name] = _Track(seen, seen)
            self._tracks[name].add(seen, estimate.weight, number=self._added)
        while self._most is not None and len(self._tracks) > self._most:
            del self._tracks[min(self._tracks, key=lambda name: self._tracks[name].seen)]

    def modes(self, posterior: FoundationPosterior | None = None) -> list[CombinedMode]:
        """Return one entry a track, lowest frequency first; with a posterior also the model modes
        that they were taken for."""
        latest = {name: track.latest for name, track in self._tracks.items()}
        pairs: dict[str, ModePair] = {}
        if posterior is not None:
            channels = self._channels.get(posterior.time_ns, ())
            pairs = pairs_by_track(latest, posterior, channels)
        combined = [track.combined(name, pairs.get(name)) for name, track in self._tracks.items()]
        return sorted(combined, key=lambda mode: mode.frequency)


def pairs_by_track(
    latest: Mapping[str, SeenMode], posterior: FoundationPosterior, channels: Sequence[str]
) -> dict[str, ModePair]:
    """Return the pair of each track, by the track's name.

    Two modes that cannot be separated have one pair, "m1+m2": each of them is then named after the
    model mode near the pair whose shape it has. A mode that other windows did separate also has a
    pair of its own, which is its own and no other one's.

    Parameters
    ----------
    latest : mapping of str to SeenMode
        The last mode of each track.
    posterior : FoundationPosterior
        Whose pairs these are.
    channels : sequence of str
        Of the posterior's window; of none that is known, pairs are not told apart by their shapes.
    """
    pairs = {pair.identified: pair for pair in posterior.pairs if "+" not in pair.identified}
    taken = {pair.model for pair in pairs.values()}
    for pair in posterior.pairs:
        if "+" in pair.identified:
            members = [
                name for name in pair.identified.split("+") if name in latest and name not in pairs
            ]
            seen = [latest[name] for name in members]
            found = _member_pairs(seen, pair, posterior, channels, taken=taken)
            pairs |= dict(zip(members, found, strict=True))
    return pairs


def _member_pairs(
    modes: Sequence[SeenMode],
    pair: ModePair,
    posterior: FoundationPosterior,
    channels: Sequence[str],
    *,
    taken: Set[str],
) -> list[ModePair]:
    """Return the pair of each of the modes that one pair stands for, no two alike where the model
    has as many modes near it that are not taken."""
    known = all(set(each.channels) == set(channels) for each in modes)
    if not modes or not known or posterior.model_shapes.shape[1] != len(channels):
        return [pair] * len(modes)
    from scipy.optimize import linear_sum_assignment  # slow to load; few runs have such a pair

    # A rough model's two modes lie on one side of the pair, the other one farther off.
    apart = np.maximum(
        [each.mode.frequency_std for each in modes], abs(pair.model_frequency - pair.frequency)
    )
    near = np.abs(posterior.model_frequencies[:, None] - pair.frequency) <= 3 * apart
    free = np.array([label not in taken for label in posterior.model_labels])[:, None]
    shapes = np.array([each.shape_at(channels) for each in modes])
    mac = modal_assurance_criterion(posterior.model_shapes, shapes) * near * free
    found = [pair] * len(modes)
    for best, member in zip(*linear_sum_assignment(mac, maximize=True), strict=True):
        if mac[best, member] > 0:
            found[member] = replace(
                pair,
                model=posterior.model_labels[best],
                model_frequency=float(posterior.model_frequencies[best]),
                mac=float(mac[best, member]),
            )
    return found


@dataclass(slots=True)
class _WeightedMean:
    """Mean of independent estimates of one figure; overlapping windows count samples once."""

    n: int = 0
    total: float = 0.0
    weighted: float = 0.0  # Σ w x / s²
    precision: float = 0.0  # Σ w / s²
    is_weighted: bool = True  # every std is known and positive

    def add(self, value: float, std: float, weight: float) -> None:
        """Enter one more."""
        with np.errstate(all="ignore"):
            precision = float(np.divide(weight, np.square(std)))
        self.n += 1
        self.total += value
        self.is_weighted &= bool(np.isfinite(precision) and precision > 0)
        if self.is_weighted:
            self.weighted += precision * value
            self.precision += precision

    @property
    def mean_and_std(self) -> tuple[float, float]:
        """The plain mean, of unknown std, where one of the weights is not known."""
        if not self.is_weighted:
            return self.total / self.n, float("nan")
        return self.weighted / self.precision, float(self.precision**-0.5)


@dataclass(slots=True)
class _Track:
    """What the windows that saw a mode add up to."""

    latest: SeenMode
    sharpest: SeenMode
    seen: int = 0  # number of the last window that saw it
    quality: float = 0.0  # summed
    frequency: _WeightedMean = field(default_factory=_WeightedMean)
    damping: _WeightedMean = field(default_factory=_WeightedMean)

    def add(self, seen: SeenMode, weight: float, *, number: int) -> None:
        """Enter one more window that saw it."""
        self.latest, self.seen = seen, number
        mode = seen.mode
        if mode.frequency_std < self.sharpest.mode.frequency_std:
            self.sharpest = seen
        self.quality += mode.quality
        self.frequency.add(mode.frequency, mode.frequency_std, weight)
        self.damping.add(mode.damping_ratio, mode.damping_ratio_std, weight)

    def combined(self, name: str, pair: ModePair | None) -> CombinedMode:
        """Return the track's entry, named after the model's mode where it was paired."""
        frequency, frequency_std = self.frequency.mean_and_std
        damping, damping_std = self.damping.mean_and_std
        return CombinedMode(
            name=name if pair is None else pair.model,
            frequency=frequency,
            frequency_std=frequency_std,
            damping_ratio=damping,
            damping_ratio_std=damping_std,
            shape=tuple(float(component) for component in self.sharpest.mode.shape),
            seen_in_windows=self.frequency.n,
            pair_id=self.latest.mode.pair_id,
            quality=self.quality / self.frequency.n,
            pair=pair,
            channels=self.sharpest.channels,
        )
