"""Pairing where modes are missing, invented or spoilt: how often it goes wrong, how often it
declines."""

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pipeline.messages import Mode
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.pairing import PairingSearch, PairingSettings, PairingTargets
from pipeline.updating.prior import Prior, modal_where_supported
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from tests.benchmarks._drawn import (
    DURATION,
    SHAPE_STD,
    TrueModes,
    drawn_mode,
    drawn_window,
    turbine_model,
)

Kind = Literal["clean", "contaminated", "spurious"]

FOUND = 0.75  # chance of a mode that the sensors see to be identified [-]
CONTAMINATED = 0.15  # chance of one that is to be spoilt [-]
MIXED = 0.5  # largest share of another mode in a spoilt shape, of its largest component [-]
SHIFTED = 0.004  # standard deviation of a spoilt frequency's further error [-]
SPURIOUS = 3.0  # invented modes a window, mean of a Poisson distribution
COPIED = 0.5  # chance of an invented mode to have another mode's shape [-]
RESOLUTION = 1.5 / DURATION  # [Hz]: true modes nearer than this may be taken for each other, and
# the likelihood is told so


@dataclass(frozen=True, slots=True)
class Trial:
    """One window's modes, lowest frequency first, and what each of them is."""

    modes: tuple[Mode, ...]
    kinds: tuple[Kind, ...]


def drawn_trial(true: TrueModes, generator: np.random.Generator) -> Trial:
    """What a window might find. A mode's name is its true label, "" for an invented one."""
    kept = generator.random(len(true.labels)) < FOUND
    spoilt = kept & (generator.random(len(true.labels)) < CONTAMINATED)
    window = drawn_window(true, generator.standard_normal(true.values.shape), window=0)
    found: list[tuple[Mode, Kind]] = []
    for mode in window.modes:
        row = true.labels.index(mode.name)
        if spoilt[row]:
            found.append((_spoilt(mode, true, generator), "contaminated"))
        elif kept[row]:
            found.append((mode, "clean"))
    invented = [_invented(true, generator) for _ in range(generator.poisson(SPURIOUS))]
    found += [(mode, "spurious") for mode in invented]
    found.sort(key=lambda each: each[0].frequency)
    return Trial(tuple(mode for mode, _ in found), tuple(kind for _, kind in found))


def _spoilt(mode: Mode, true: TrueModes, generator: np.random.Generator) -> Mode:
    """With a share of another mode in its shape, and further off in frequency."""
    other = true.values[generator.integers(len(true.values)), 1:]
    shape = mode.shape + generator.uniform(-MIXED, MIXED) * other
    frequency = mode.frequency * (1 + SHIFTED * generator.standard_normal())
    return _like(mode.name, frequency, shape, true)


def _invented(true: TrueModes, generator: np.random.Generator) -> Mode:
    """A mode that there is not: another's shape or any shape, anywhere in the band."""
    lowest, highest = np.log(true.values[[0, -1], 0])
    frequency = float(np.exp(generator.uniform(lowest, highest)))
    shape = generator.standard_normal(true.values.shape[1] - 1)
    if generator.random() < COPIED:
        copied = true.values[generator.integers(len(true.values))]
        shape = copied[1:] + 0.02 * shape
    return _like("", frequency, shape, true)


def _like(name: str, frequency: float, shape: FloatArray, true: TrueModes) -> Mode:
    """A mode with the standard deviations of the true one nearest to it in frequency."""
    nearest = int(np.argmin(np.abs(np.log(true.values[:, 0] / frequency))))
    values = np.append(frequency, shape / shape[np.argmax(np.abs(shape))])
    deviations = np.where(values == 1.0, 0.0, SHAPE_STD)
    deviations[0] = true.deviations[nearest, 0]
    return drawn_mode(name, values, deviations)


@dataclass(frozen=True, slots=True)
class PairingCounts:
    """Over all trials."""

    identified: Counter[Kind]
    paired: Counter[Kind]  # rightly or wrongly
    wrong: Counter[Kind]

    @property
    def wrong_share(self) -> float:
        """Of all pairs made [-]."""
        return self.wrong.total() / max(self.paired.total(), 1)


def pairing_counts(n_trials: int, *, first_seed: int, whole_prior: bool = True) -> PairingCounts:
    """Pair drawn windows from the whole prior and count.

    whole_prior   whether the truth is drawn there too, or in .8 to 1.25 of nominal
    """
    model = turbine_model(None)
    prior = Prior(model.nominal)
    search = PairingSearch(model, prior, PairingSettings(), np.random.default_rng(0))
    counts = PairingCounts(Counter(), Counter(), Counter())
    for seed in range(first_seed, first_seed + n_trials):
        generator = np.random.default_rng([seed, 99])
        true = TrueModes.of(model, _truth(model, prior, generator, whole_prior=whole_prior))
        _count(drawn_trial(true, generator), true, search, counts)
    return counts


def _truth(
    model: ModalModel, prior: Prior, generator: np.random.Generator, *, whole_prior: bool
) -> FloatArray:
    """(3,) ratios of a structure that stands."""
    while True:
        drawn = prior.draws(1, generator) if whole_prior else generator.uniform(0.8, 1.25, (1, 3))
        supported, modes = modal_where_supported(model, prior, drawn)
        if supported[0] and modes is not None and modes.admissible[0]:
            return drawn[0]


def _count(trial: Trial, true: TrueModes, search: PairingSearch, counts: PairingCounts) -> None:
    estimate = drawn_window(true, np.zeros_like(true.values), window=0)
    estimate = replace(estimate, modes=trial.modes)
    evidence = ModalEvidence(channels=true.layout.channel_names).with_estimate(estimate)
    pairing = search.best(PairingTargets.of(evidence.modes, 1))
    frequencies = true.values[:, 0]
    for mode, kind, partner in zip(trial.modes, trial.kinds, pairing.model_modes, strict=True):
        counts.identified[kind] += 1
        if partner < 0:
            continue
        counts.paired[kind] += 1
        own = true.labels.index(mode.name) if mode.name else -1
        alike = own >= 0 and abs(frequencies[own] - frequencies[partner]) < RESOLUTION
        counts.wrong[kind] += not alike


def pairing_part(n_trials: int, first_seed: int) -> None:
    """Print the counts."""
    print(f"\npairing from the whole prior, {n_trials} trials")
    for words, whole_prior in (("truth anywhere in it", True), ("truth in .8 to 1.25", False)):
        half = n_trials // 2
        counts = pairing_counts(half, first_seed=first_seed, whole_prior=whole_prior)
        print(f"{words}: {counts.wrong_share:.2%} of {counts.paired.total()} pairs wrong")
        for kind in ("clean", "contaminated", "spurious"):
            n = counts.identified[kind]
            print(
                f"  {kind:14s}{n:8d}  left alone {1 - counts.paired[kind] / n:7.2%}"
                f"  wrongly paired {counts.wrong[kind] / n:7.2%}",
                flush=True,
            )
