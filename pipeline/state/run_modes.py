"""The modes of a whole session: one entry a track, combined over the windows that saw it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import FoundationPosterior, ModalEstimate, Mode, ModePair
from pipeline.modal_assurance import modal_assurance_criterion
from sensors.json_values import Json, known


@dataclass(frozen=True, slots=True, eq=False)
class CombinedMode:
    """One mode over all windows that saw it."""

    name: str  # the model's label where it was paired, else the track's name
    frequency: float  # precision-weighted mean over the windows [Hz]
    frequency_std: float  # of that mean [Hz]
    damping_ratio: float  # [-]
    damping_ratio_std: float  # [-]
    shape: tuple[float, ...]  # of the window that saw it sharpest [-]
    seen_in_windows: int
    pair_id: str
    quality: float
    pair: ModePair | None = None  # with a model mode

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


def combined_modes(
    estimates: Sequence[ModalEstimate], posterior: FoundationPosterior | None = None
) -> list[CombinedMode]:
    """The modes of all windows, one entry per track, lowest frequency first; with a posterior
    also the model modes that they were taken for."""
    sightings: dict[str, list[tuple[Mode, float]]] = {}
    for estimate in estimates:
        for number, mode in enumerate(estimate.modes):
            name = mode.name or f"window {estimate.window} mode {number + 1}"
            sightings.setdefault(name, []).append((mode, estimate.weight))
    latest = {name: seen[-1][0] for name, seen in sightings.items()}
    pairs = pairs_by_track(latest, posterior) if posterior else {}
    combined = [_combined(name, seen, pairs.get(name)) for name, seen in sightings.items()]
    return sorted(combined, key=lambda mode: mode.frequency)


def pairs_by_track(
    latest: Mapping[str, Mode], posterior: FoundationPosterior
) -> dict[str, ModePair]:
    """Return the pair of each track, by the track's name.

    Two modes that cannot be separated have one pair, "m1+m2": each of them is then named after the
    model mode near the pair whose shape it has.

    Parameters
    ----------
    latest : mapping of str to Mode
        The last mode of each track.
    posterior : FoundationPosterior
        Whose pairs these are.
    """
    pairs = {pair.identified: pair for pair in posterior.pairs}
    for together in [name for name in pairs if "+" in name]:
        pair = pairs.pop(together)
        for member in together.split("+"):
            if member in latest:
                pairs[member] = _member_pair(latest[member], pair, posterior)
    return pairs


def _member_pair(mode: Mode, pair: ModePair, posterior: FoundationPosterior) -> ModePair:
    if posterior.model_shapes.shape[1] != len(mode.shape):
        return pair
    near = np.abs(posterior.model_frequencies - pair.frequency) <= max(
        3 * mode.frequency_std, abs(pair.model_frequency - pair.frequency)
    )
    mac = modal_assurance_criterion(posterior.model_shapes, mode.shape[None])[:, 0] * near
    best = int(np.argmax(mac))
    return replace(
        pair,
        model=posterior.model_labels[best],
        model_frequency=float(posterior.model_frequencies[best]),
        mac=float(mac[best]),
    )


def _combined(name: str, seen: Sequence[tuple[Mode, float]], pair: ModePair | None) -> CombinedMode:
    modes = [mode for mode, _ in seen]
    weights = np.array([weight for _, weight in seen])
    frequency, frequency_std = _weighted_mean(
        [mode.frequency for mode in modes], [mode.frequency_std for mode in modes], weights
    )
    damping, damping_std = _weighted_mean(
        [mode.damping_ratio for mode in modes],
        [mode.damping_ratio_std for mode in modes],
        weights,
    )
    sharpest = min(modes, key=lambda mode: mode.frequency_std)
    return CombinedMode(
        name=name if pair is None else pair.model,
        frequency=frequency,
        frequency_std=frequency_std,
        damping_ratio=damping,
        damping_ratio_std=damping_std,
        shape=tuple(float(component) for component in sharpest.shape),
        seen_in_windows=len(modes),
        pair_id=modes[-1].pair_id,
        quality=float(np.mean([mode.quality for mode in modes])),
        pair=pair,
    )


def _weighted_mean(
    values: Sequence[float], stds: Sequence[float], weights: np.ndarray
) -> tuple[float, float]:
    """Mean and std of independent estimates; `weights` count overlapping windows once."""
    with np.errstate(all="ignore"):
        precisions = weights / np.square(stds)
    if not np.all(np.isfinite(precisions)) or not np.all(precisions > 0):
        return float(np.mean(values)), float("nan")
    total = float(precisions.sum())
    return float(np.dot(precisions, values) / total), total**-0.5
