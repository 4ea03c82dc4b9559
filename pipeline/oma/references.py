"""Which channels serve as references: the ones that lag covariances are taken with.

With all n channels every pair is used. A few good ones (where every mode moves, with little noise)
make the Hankel matrix narrower and everything after it cheaper, and leave the noise of poor sensors
out of half of each product. A mode that no reference sees is lost.

Of more than 32 channels not all can be references: the covariances of a hundred would take
gigabytes. Those are taken that together explain most of the others.
Source: Peeters and De Roeck (1999), Reference-based stochastic subspace identification for
output-only modal analysis, Mech. Syst. Signal Process. 13.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.oma.settings import OmaSettings, OmaSettingsError
from pipeline.oma.ssi.covariance import ALL, References
from sensors.arrays import FloatArray

MOST_PAIRS = 1024  # channels × references that are chosen by themselves
FEWEST_REFERENCES = 4
EXPLAINED = 1e-6  # of a channel's variance: less is left where the others know it [-]


def references_among(channel_names: Sequence[str], settings: OmaSettings) -> References:
    """Indices of the reference channels among a record's channels.

    Raises OmaSettingsError where a name is no channel's.
    """
    wanted = settings.reference_channels
    if wanted is None:
        return ALL
    for name in wanted:
        if name not in channel_names:
            raise OmaSettingsError(
                f"[oma] reference_channels has {name!r}; the channels are "
                f"{', '.join(channel_names)}"
            )
    return np.array([list(channel_names).index(name) for name in wanted], dtype=np.intp)


def settings_for_channels(settings: OmaSettings, channel_names: Sequence[str]) -> OmaSettings:
    """The settings for a window that lacks some channels, those of a silent unit for example.

    Its references are those that are left; all channels, where none is.
    """
    if settings.reference_channels is None:
        return settings
    left = tuple(name for name in settings.reference_channels if name in channel_names)
    return replace(settings, reference_channels=left or None)


def takes_some(n_channels: int, settings: OmaSettings) -> bool:
    """Whether so many channels cannot all be references, and nobody has named any."""
    return settings.reference_channels is None and n_channels**2 > MOST_PAIRS


def with_bounded_references(
    samples: FloatArray, channel_names: Sequence[str], settings: OmaSettings
) -> OmaSettings:
    """The settings with as many references as the channels of a window, (n, n_channels), can have.

    The references are chosen one after the other, each so that it explains most of what the
    correlations R of all channels still hold: Σ_j R_ij² / R_ii is largest, and R_i R_iᵀ / R_ii
    is taken off. What only one channel feels, its noise, is chosen last.
    """
    n_channels = samples.shape[1]
    if not takes_some(n_channels, settings):
        return settings
    scales = samples.std(axis=0)
    scaled = (samples - samples.mean(axis=0)) / np.where(scales > 0, scales, 1.0)
    left = scaled.T @ scaled / len(scaled)
    chosen: list[int] = []
    for _ in range(max(FEWEST_REFERENCES, MOST_PAIRS // n_channels)):
        power = np.diag(left)
        known = power <= EXPLAINED
        gained = np.where(known, 0.0, (left**2).sum(axis=0) / np.where(known, 1.0, power))
        best = int(np.argmax(gained))
        if not gained[best] > 0:
            break
        chosen.append(best)
        left = left - np.outer(left[best], left[best]) / power[best]
    names = tuple(channel_names[index] for index in sorted(chosen))
    return replace(settings, reference_channels=names or None)
