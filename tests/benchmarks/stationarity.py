"""Ring-downs and stops inside a window, and the alarms of windows that are stationary.

    python -m tests.benchmarks stationarity [--first-seed 90001] [--records 200] [--keep]

Every seed draws a tower's first and second bending modes (.16 to .3 Hz and five to eight times
that, ζ .5 to 2 %), 600 s at 10 Hz, 8 channels, 1 to 30 % of noise, under white forces whose
strength follows the wind of `paper`: (1 + .1 g)² with g Kaimal's turbulence at 2 m/s.

blow    a first mode rings down from 5 to 20 times the strongest channel's rms, from a moment in
        the first 480 s
stop    the forces fall to 1/5 to 1/20 of their strength between 60 and 480 s
quiet   neither

The checks of a window's samples are run, without the identification. Every seed of `blow` and
`stop` is run once with the range, once with five times.
"""

import numpy as np
from scipy.signal import lfilter

from pipeline.oma.data_quality.input_checks import check_stationarity
from sensors.arrays import FloatArray
from sensors.loads.spectra import kaimal
from tests.benchmarks._seeded import report, seeded_options

DURATION, RATE = 600.0, 10.0
TURBULENCE, SPEED, LENGTH = 0.1, 2.0, 340.2  # intensity [-], [m/s], scale of Kaimal's spectrum [m]
HEIGHT = np.array([0.3, 0.55, 0.75, 1.0])


def gusts(n: int, generator: np.random.Generator) -> FloatArray:
    """Turbulence of variance 1, (n,)."""
    f = np.fft.rfftfreq(n, 1 / RATE)
    density = np.where(
        f < 1.0, kaimal(f, wind_speed=SPEED, deviation=TURBULENCE * SPEED, length=LENGTH), 0.0
    )
    noise = generator.standard_normal((2, len(f)))
    series = np.fft.irfft(np.sqrt(density) * (noise[0] + 1j * noise[1]), n)
    return np.asarray((series - series.mean()) / series.std())


def record(seed: int, kind: str = "quiet", times: float | None = None) -> FloatArray:
    """Samples, (n, 8), of one kind. times: of the decay; drawn by default."""
    generator = np.random.default_rng(seed)
    first = generator.uniform(0.16, 0.3)
    second = first * generator.uniform(5, 8)
    frequencies = np.array(
        [
            first,
            first * (1 + generator.uniform(0.005, 0.04)),
            second,
            second * generator.uniform(1.01, 1.1),
        ]
    )
    damping = generator.uniform(0.005, 0.02, 4)
    low, high = HEIGHT**1.8, np.sin(np.pi * HEIGHT * 1.05) - 0.6 * HEIGHT**2
    axes = generator.uniform(0, np.pi, 2)
    shapes = np.array(
        [
            np.column_stack([shape * np.cos(angle), shape * np.sin(angle)]).ravel()
            for shape, angle in zip(
                (low, low, high, high),
                (axes[0], axes[0] + np.pi / 2, axes[1], axes[1] + np.pi / 2),
                strict=True,
            )
        ]
    )
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    levels = np.array(
        [1.0, np.exp(generator.uniform(np.log(0.2), np.log(5))), *generator.uniform(0.3, 3, 2)]
    )
    n = round(DURATION * RATE)
    warm = round(min(3 / (2 * np.pi * (frequencies * damping).min()), 300.0) * RATE)
    strength = (1 + TURBULENCE * np.clip(gusts(n + warm, generator), -4, 4)) ** 2
    time = np.arange(n) / RATE
    drawn = float(np.exp(generator.uniform(np.log(5), np.log(20))))
    decay = drawn if times is None else times
    if kind == "stop":
        strength[warm:] *= np.where(time < generator.uniform(60, 480), 1.0, 1 / decay)
    samples = np.zeros((n, 8))
    for f, zeta, shape, level in zip(frequencies, damping, shapes, levels, strict=True):
        pole = (-zeta + 1j * np.sqrt(1 - zeta**2)) * 2 * np.pi * f
        white = generator.standard_normal((2, n + warm))
        force = (white[0] + 1j * white[1]) * strength
        motion = lfilter([1.0], [1.0, -np.exp(pole / RATE)], force)[warm:].imag
        samples += level * np.sqrt(4 * np.pi * zeta * f / RATE) * np.outer(motion, shape)
    if kind == "blow":
        after = time - generator.uniform(0, 480)
        mode = int(generator.integers(2))
        omega = 2 * np.pi * frequencies[mode]
        ring = np.exp(-damping[mode] * omega * after) * np.cos(omega * after)
        peak = decay * np.sqrt(2) * samples.std(axis=0).max()
        samples += np.outer(peak * np.where(after > 0, ring, 0.0), shapes[mode])
    level = samples[-round(60 * RATE) :].std(axis=0) if kind == "stop" else samples.std(axis=0)
    share = np.exp(generator.uniform(np.log(0.01), np.log(0.3)))
    return np.asarray(samples + share * level * generator.standard_normal(samples.shape))


def warned(samples: FloatArray) -> bool:
    """Whether the checks call it non-stationary."""
    return bool(check_stationarity(samples, RATE))


def figures(first_seed: int, records: int, quiet: int) -> dict[str, float]:
    """Share of the records that are warned of, by kind."""
    found = {}
    for kind in ("blow", "stop"):
        for name, times in (("5..20", None), ("5", 5.0)):
            seeds = range(first_seed, first_seed + records)
            found[f"{kind} x{name}"] = float(
                np.mean([warned(record(seed, kind, times)) for seed in seeds])
            )
    alarms = [warned(record(seed)) for seed in range(first_seed, first_seed + quiet)]
    return found | {"records": records, "quiet": quiet, "false alarms": float(np.mean(alarms))}


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    parser = seeded_options("stationarity", first_seed=90_001, records=200)
    parser.add_argument("--quiet", type=int, default=2000)
    options = parser.parse_args(arguments)
    found = figures(options.first_seed, options.records, options.quiet)
    seeds = range(options.first_seed, options.first_seed + options.quiet)
    report("stationarity", found, options, seeds=seeds, depends="pipeline/oma/data_quality")
