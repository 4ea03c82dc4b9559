"""Two modes nearer than the window can tell apart: a joint estimate instead of two wrong ones.

A round tower has a fore-aft and a side-side bending mode of almost one frequency. When they lie
within the window's resolution 1/T, the order of the two in frequency and their axes in the plane
that they span cannot be known; a subspace method then gives one pole for both, or two wrong ones.
What the window does know is the plane, the pair's mean frequency and, when the axes shake
unequally, roughly the axes. Such a pair becomes two entries with one `pair_id`, whose covariance
says so.

How a hidden partner shows: in the narrow band f ± 2/T the spectral matrix of a single lightly
damped mode has one large eigenvalue, that of a pair has two, far above the third.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from pipeline.messages import Mode
from pipeline.oma.ssi.coincident_modes import CoincidentModes
from sensors.arrays import FloatArray, IntArray

UNRESOLVED = 3.0  # ζ f T below which the window does not resolve the mode's own resonance [-]
HALF_WIDTH = 2.0  # of the narrow band, in lines 1/T
ABOVE_REST = 20.0  # a partner's eigenvalue over the next one [-]
LEAST_SHARE = 1e-3  # of a partner's power in the mode's; less is noise or a skewed sensor [-]
PEAK_OVER_FLANK = 3.0  # a partner resonates: its power in the band over that beside it [-]


@dataclass(frozen=True, slots=True, eq=False)
class Partner:
    """The second direction that shakes at a mode's frequency."""

    shape: FloatArray  # (n_channels,), any scale, in the samples' units [-]
    power_share: float  # of the mode's own power [-]
    noise_share: float  # power of the next direction over the partner's [-]


class NarrowBandSpectrum:
    """Spectral matrices of a window in bands a few lines wide, with accelerations' phases."""

    def __init__(
        self, samples: FloatArray, sampling_rate: float, integrations: IntArray | None = None
    ):
        """samples: (n, n_channels), free of offset;  integrations: (n_channels,)"""
        n = len(samples)
        self.duration = n / sampling_rate
        self._scales = np.sqrt(np.mean(samples**2, axis=0))
        taper = np.hanning(n)[:, None]
        self._integrations = np.zeros(samples.shape[1]) if integrations is None else integrations
        self._lines = fft.rfft(samples / self._scales * taper, axis=0) * 1j**self._integrations

    def partner_of(self, mode: Mode) -> Partner | None:
        """The hidden partner of a mode; None where the mode is alone."""
        scales = self._scales * (2 * np.pi * mode.frequency) ** self._integrations
        own = mode.shape / scales
        own = own / np.linalg.norm(own)
        rest = self._matrix(mode.frequency, 0, HALF_WIDTH)
        power = own @ rest @ own
        outside = np.eye(len(own)) - np.outer(own, own)
        values, vectors = np.linalg.eigh(outside @ rest @ outside)
        second, third = values[-1], max(values[-2], np.finfo(float).tiny)
        direction = vectors[:, -1]
        flank = self._matrix(mode.frequency, 3 * HALF_WIDTH, 5 * HALF_WIDTH)
        if (
            second < ABOVE_REST * third
            or second < LEAST_SHARE * power
            or second < PEAK_OVER_FLANK * (direction @ flank @ direction)
        ):
            return None
        return Partner(direction * scales, float(second / power), float(third / second))

    def plane_at(self, frequency: float, half_width: float) -> tuple[FloatArray, Partner] | None:
        """The two directions that shake within so many lines of a frequency, the stronger one's
        shape in the samples' units; None where there are not just two."""
        values, vectors = np.linalg.eigh(self._matrix(frequency, 0, half_width))
        first, second, third = values[-1], values[-2], max(values[-3], np.finfo(float).tiny)
        if second < ABOVE_REST * third:
            return None
        scales = self._scales * (2 * np.pi * frequency) ** self._integrations
        shape = vectors[:, -1] * scales
        partner = Partner(vectors[:, -2] * scales, float(second / first), float(third / second))
        return shape / shape[np.argmax(np.abs(shape))], partner

    def _matrix(self, frequency: float, nearest: float, farthest: float) -> FloatArray:
        """Mean real spectral matrix of the lines whose distance from f, in 1/T, is in between."""
        distance = np.abs(np.arange(len(self._lines)) - frequency * self.duration)
        lines = self._lines[(distance >= nearest) & (distance <= farthest)]
        return np.asarray((lines.T @ lines.conj()).real / max(1, len(lines)))


def with_close_pairs(
    modes: Sequence[Mode],
    samples: FloatArray,
    sampling_rate: float,
    integrations: IntArray | None = None,
) -> tuple[Mode, ...]:
    """The modes with every unresolved pair as two entries of one `pair_id`.

    samples        (n, n_channels) of the window, free of offset
    integrations   of channels that measure different quantities (`quantities.py`), (n_channels,)
    """
    duration = len(samples) / sampling_rate
    candidates = [m for m in modes if m.damping_ratio * m.frequency * duration < UNRESOLVED]
    if samples.shape[1] < 3 or not candidates:
        return tuple(modes)
    spectrum = NarrowBandSpectrum(samples, sampling_rate, integrations)
    result = [m for m in modes if not any(m is c for c in candidates)]
    for group in _unresolved_groups(candidates, duration):
        leader = min(group, key=lambda m: m.frequency_std)
        partner = spectrum.partner_of(leader)
        result += group if partner is None else joint_pair(group, partner, duration)
    return tuple(sorted(result, key=lambda m: m.frequency))


def twin_pairs(
    twins: Sequence[CoincidentModes],
    samples: FloatArray,
    sampling_rate: float,
    integrations: IntArray | None = None,
) -> list[Mode]:
    """Two entries of one `pair_id` for each twins of which the window shows the plane.

    The mean's std is that of one mode by the uncertainty law (δf / f)² = (δζ)² = ζ / (2π f T)
    (Au 2014, Mechanical Systems and Signal Processing 48, 15): the mean of two is known √2 times
    better, by a subspace method about as much worse. What the orders scatter by comes to it.
    """
    if samples.shape[1] < 3 or not twins:
        return []
    spectrum = NarrowBandSpectrum(samples, sampling_rate, integrations)
    found: list[Mode] = []
    for each in twins:
        cycles = each.frequency * spectrum.duration
        plane = spectrum.plane_at(each.frequency, max(HALF_WIDTH, each.damping_ratio * cycles))
        if plane is None:
            continue
        shape, partner = plane
        law = float(np.sqrt(each.damping_ratio / (2 * np.pi * cycles)))
        factor = np.zeros((2 + len(shape), 2))
        factor[0, 0] = np.hypot(law * each.frequency, each.frequency_scatter)
        factor[1, 1] = np.hypot(law, each.damping_scatter)
        leader = Mode(
            "", each.frequency, factor[0, 0], each.damping_ratio, factor[1, 1], shape, factor, 0
        )  # fmt: skip
        found += joint_pair([leader], partner, spectrum.duration)
    return found


def _unresolved_groups(modes: Sequence[Mode], duration: float) -> list[list[Mode]]:
    """Neighbours that differ by less than the resolution or three of their joint std."""
    groups: list[list[Mode]] = []
    for mode in sorted(modes, key=lambda m: m.frequency):
        last = groups[-1][-1] if groups else None
        if last is not None:
            joint_std = float(np.hypot(mode.frequency_std, last.frequency_std))
            if mode.frequency - last.frequency < max(1 / duration, 3 * joint_std):
                groups[-1].append(mode)
                continue
        groups.append([mode])
    return groups


def joint_pair(group: Sequence[Mode], partner: Partner, duration: float) -> list[Mode]:
    """Two entries that say what is known of a pair: mean frequency, plane, rough axes.

    group   the poles found for it, one or two

    Both have the mean frequency; half a line 1/(2T) is added in quadrature to the std of the
    leader, which most of the power belongs to, and a whole one to its partner's. Each shape may
    be turned in the plane towards the other by an angle that is small only when the partner's
    power is: its std is sqrt(power share), which enters as one more column of the factor.
    """
    leader = min(group, key=lambda m: m.frequency_std)
    weights = np.array([m.frequency_std**-2 for m in group])
    mean = float(np.average([m.frequency for m in group], weights=weights))
    spread = float(np.std([m.frequency for m in group]))
    pair_id = f"{mean:.4f} Hz"
    turn = min(1.0, float(np.sqrt(partner.power_share)))
    second = partner.shape / partner.shape[np.argmax(np.abs(partner.shape))]
    resolution = 1 / duration
    return [
        _entry(
            leader,
            mean,
            leader.shape,
            towards=turn * second,
            noise=0.0,
            frequency_spread=float(np.hypot(spread, 0.5 * resolution)),
            pair_id=pair_id,
        ),
        _entry(
            leader,
            mean,
            second,
            towards=turn * leader.shape,
            noise=float(np.sqrt(partner.noise_share)),
            frequency_spread=float(np.hypot(spread, resolution)),
            pair_id=pair_id,
        ),
    ]


def _entry(
    leader: Mode,
    frequency: float,
    shape: FloatArray,
    *,
    towards: FloatArray,
    noise: float,
    frequency_spread: float,
    pair_id: str,
) -> Mode:
    """One of the two: the leader's pole with another shape and what is not known of it."""
    n_channels = len(shape)
    unit = int(np.argmax(np.abs(shape)))
    factor = np.zeros((2 + n_channels, leader.covariance_factor.shape[1] + 2 + n_channels))
    n_known = leader.covariance_factor.shape[1]
    factor[:2, :n_known] = leader.covariance_factor[:2]
    if shape is leader.shape:
        factor[2:, :n_known] = leader.covariance_factor[2:]
    factor[0, n_known] = frequency_spread
    factor[2:, n_known + 1] = towards - shape * towards[unit]  # the unit component stays 1
    factor[2:, n_known + 2 :] = noise * (
        np.eye(n_channels) - np.outer(shape, np.eye(n_channels)[unit])
    )
    return replace(
        leader,
        frequency=frequency,
        frequency_std=float(np.linalg.norm(factor[0])),
        shape=shape,
        covariance_factor=factor,
        pair_id=pair_id,
    )
