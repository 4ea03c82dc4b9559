"""Which channels serve as references: the ones that lag covariances are taken with.

With all n channels every pair is used. A few good ones (where every mode moves, with little noise)
make the Hankel matrix narrower and everything after it cheaper, and leave the noise of poor sensors
out of half of each product. A mode that no reference sees is lost.
Source: Peeters and De Roeck (1999), Reference-based stochastic subspace identification for
output-only modal analysis, Mech. Syst. Signal Process. 13.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.oma.settings import OmaSettings, OmaSettingsError
from pipeline.oma.ssi.covariance import ALL, References


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
