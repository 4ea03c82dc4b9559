"""Frequencies of each mode over the windows, named by the model's mode where paired."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModePair
from pipeline.report.recorded_session import TurbineRecord
from pipeline.state.run_modes import SeenMode, pairs_by_track
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyTrack:
    """One mode over the windows that saw it, in order of time."""

    name: str
    """Name of the track, as identification gave it."""
    model: str
    """Label of the paired model mode at the end; "" for none."""
    model_frequency: float
    """Frequency of that mode at the last posterior's median [Hz]; NaN for none."""
    information: float
    """Share of the information on the stiffness [-]; 0 for none."""
    times_ns: NDArray[np.int64]
    """Middle of the windows, shape (n,) [ns since 1970-01-01 UTC]."""
    frequencies: FloatArray
    """Natural frequencies, shape (n,) [Hz]."""
    stds: FloatArray
    """Standard deviations, shape (n,) [Hz]."""

    @property
    def label(self) -> str:
        """Label of the paired model mode ("mode 5"), else the track's own name."""
        return f"mode {self.model}" if self.model else self.name


def frequency_tracks(record: TurbineRecord) -> tuple[FrequencyTrack, ...]:
    """Return every track of a session, lowest frequency first.

    Modes without a name are left out: they have no counterpart in other windows.
    """
    seen: dict[str, list[tuple[int, float, float]]] = {}
    latest: dict[str, SeenMode] = {}
    for estimate in sorted(record.state.estimates, key=lambda estimate: estimate.start_ns):
        middle = (estimate.start_ns + estimate.end_ns) // 2
        for mode in estimate.modes:
            if mode.name:
                latest[mode.name] = SeenMode(mode, estimate.channels)
                seen.setdefault(mode.name, []).append((middle, mode.frequency, mode.frequency_std))
    posterior = record.state.posterior
    pairs: dict[str, ModePair] = {}
    if posterior is not None:
        ends = {estimate.end_ns: estimate.channels for estimate in record.state.estimates}
        pairs = pairs_by_track(latest, posterior, ends.get(posterior.time_ns, ()))
    tracks = [_track(name, rows, pairs.get(name)) for name, rows in seen.items()]
    return tuple(sorted(tracks, key=lambda track: float(np.median(track.frequencies))))


def _track(
    name: str, rows: Sequence[tuple[int, float, float]], pair: ModePair | None
) -> FrequencyTrack:
    times, frequencies, stds = zip(*rows, strict=True)
    return FrequencyTrack(
        name=name,
        model="" if pair is None else pair.model,
        model_frequency=float("nan") if pair is None else pair.model_frequency,
        information=0.0 if pair is None else float(np.nan_to_num(pair.information)),
        times_ns=np.array(times, dtype=np.int64),
        frequencies=np.array(frequencies),
        stds=np.array(stds),
    )


def most_informative(tracks: Sequence[FrequencyTrack], number: int) -> tuple[FrequencyTrack, ...]:
    """Return the tracks with most information on the stiffness, then those found most often.

    Lowest frequency first.
    """
    best = sorted(tracks, key=lambda track: (track.information, len(track.times_ns)), reverse=True)
    chosen = {track.name for track in best[:number]}
    return tuple(track for track in tracks if track.name in chosen)
