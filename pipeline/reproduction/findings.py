"""Sentences on what agrees with the publication, what differs and why, computed from the run."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.reproduction.deterministic import Descent
from pipeline.reproduction.example import Example, ExampleMode
from pipeline.reproduction.paper import LABELS, MAP_ERRORS, MAP_SIGMA, TABLE_1, TABLE_2
from pipeline.reproduction.study import (
    Study,
    found_counts,
    lowest_start,
    map_errors,
    n_peaks,
)
from pipeline.updating.samplers.interface import Peak

SPRING_NAMES = ("k11", "k22", "k12")
TEN_MINUTES_RESOLVE = 1 / 600  # of ten minutes [Hz]
MIXED = 0.012  # modes nearer than this share of f mix in some windows [-]
GAUSSIAN_90 = 1.645  # half width of a Gaussian's 90 % interval in stds [-]
STRONG = 0.5  # a correlation from which it is called strong [-]
ALIKE_MEANS = 0.05  # two figures that differ by less are called alike, relative
SEPARATED = 0.9  # MAC from which a mode's shape is its own [-]
# rms of errors over their stds from which these are not the whole error: of some 60 Gaussian errors
# it would lie .09 about 1 [-]
TOO_NARROW = 1.2
LIKE_TABLE_1 = 1.5  # rms of the model's frequencies to the printed ones, by which it is theirs [%]


def findings(study: Study) -> list[str]:
    """Return one paragraph a subject, in the order of the publication.

    Every conclusion depends on the run's own figures: one that is false of this run is not drawn.
    """
    example = study.first
    return [
        _modes_of_the_model(example),
        _modes_found(example),
        _shapes(example),
        _objective(example),
        _descents(example),
        _map(example),
        *_intervals(study),
        _sampler_bias(example),
        _correlation(example),
        _sign(study),
    ]


def _percent_apart(example: Example) -> list[float]:
    """Return differences of the model's frequencies at K0 from the printed ones [%]."""
    return [
        100.0 * (ours.model_frequency / theirs.model_frequency - 1)
        for ours, theirs in zip(example.modes, TABLE_1, strict=True)
    ]


def _modes_of_the_model(example: Example) -> str:
    apart = _percent_apart(example)
    worst = int(np.argmax(np.abs(apart)))
    return (
        f"The model's eleven frequencies at K0 differ from the printed ones by "
        f"{np.sqrt(np.mean(np.square(apart))):.1f} % rms, most for mode {LABELS[worst]} "
        f"({apart[worst]:+.1f} %). The publication does not print its blade reduction, its "
        "discretisation of the blades and the heights of its sensors; ours are 41, 80, 106 and "
        "145 m."
    )


def _modes_found(example: Example) -> str:
    missing = [mode for mode in example.modes if not np.isfinite(mode.frequency)]
    found = len(LABELS) - len(missing)
    text = (
        f"Of the eleven modes {found} were found in this window, and {example.others} others of "
        "the model, which the publication does not list; the remaining "
        f"{example.unpaired} identified modes are paired with no mode of the model."
    )
    reasons = [f"Not mode {mode.label}: {_why_missing(mode, example)}." for mode in missing]
    return " ".join([text, *reasons])


def _why_missing(mode: ExampleMode, example: Example) -> str:
    """Return what the model's frequencies say of it; else what is left."""
    others = [each for each in example.modes if each.label != mode.label]
    nearest = min(others, key=lambda each: abs(each.model_frequency - mode.model_frequency))
    gap = abs(nearest.model_frequency - mode.model_frequency)
    if gap < TEN_MINUTES_RESOLVE:
        return (
            f"it lies {gap:.4f} Hz from mode {nearest.label}, less than the "
            f"{TEN_MINUTES_RESOLVE:.4f} Hz that ten minutes resolve"
        )
    if gap < MIXED * mode.model_frequency:
        return f"it lies {100.0 * gap / mode.model_frequency:.1f} % from mode {nearest.label}"
    return "no identified mode was paired with it"


def _shapes(example: Example) -> str:
    ours = {mode.label: mode.mac for mode in example.modes}
    pairs = [
        f"mode {mode.label}: {ours[mode.label]:.3f}, printed {mode.mac:.3f}"
        for mode in TABLE_1
        if mode.label in ("1", "4") and np.isfinite(ours[mode.label])
    ]
    if not pairs:
        return (
            "The side-side modes 1 and 4, whose MAC is printed as 0.038 and 0.309, were not found "
            "here, so their shapes are not compared."
        )
    text = f"MAC of the side-side modes ({'; '.join(pairs)})."
    side_side = [mode for mode in example.modes if mode.label in ("1", "4")]
    apart = [m.label for m in side_side if m.mac >= SEPARATED and not m.unresolved]
    if apart:
        text += (
            f" {_modes_named(apart)} separated here from the fore-aft neighbour; the printed "
            "values are what one gets where they are not."
        )
    mixed = [mode.label for mode in side_side if mode.unresolved]
    if mixed:
        text += (
            f" {_modes_named(mixed)} not separated here from its neighbour: of the two the window "
            "shows the mean frequency, and each shape is some mixture of both."
        )
    return text


def _modes_named(labels: Sequence[str]) -> str:
    """Return "Mode 1 is" or "Modes 1 and 4 are"."""
    return f"Mode {labels[0]} is" if len(labels) == 1 else f"Modes {' and '.join(labels)} are"


def _objective(example: Example) -> str:
    printed = sum(1 - mode.mac for mode in TABLE_1)
    side_side = sum(1 - mode.mac for mode in TABLE_1 if mode.label in ("1", "4"))
    return (
        f"J(K0) is {example.objective_at_truth:.3f} here; the printed MAC values alone give "
        f"{printed:.2f}, of which modes 1 and 4 make {side_side:.2f}: J counts a mode that is "
        "badly seen as much as any other."
    )


def _descents(example: Example) -> str:
    ends = "; ".join(
        f"γ = {d.start[0]:g} ends at J = {d.objective:.3f} with errors {_end_errors(d)} %"
        if not d.runs_away
        else f"γ = {d.start[0]:g} runs away to rigid springs at J = {d.objective:.3f}"
        for d in example.descents
    )
    printed = "; ".join(
        f"γ = {row.start:g}: J = {row.objective:g}, "
        + " ".join(f"{error:+.0f}" for error in row.errors)
        + " %"
        for row in TABLE_2
    )
    return (
        f"Nelder and Mead's simplex from three starts: {ends}. Printed: {printed}. "
        f"{_of_the_starts(example)}"
    )


def _end_errors(descent: Descent) -> str:
    return ", ".join(f"{100.0 * (ratio - 1):+.1f}" for ratio in descent.end)


def _of_the_starts(example: Example) -> str:
    away = [f"γ = {descent.start[0]:g}" for descent in example.descents if descent.runs_away]
    ends = np.array([d.end for d in example.descents if not d.runs_away])
    if not away and np.all(np.ptp(ends, axis=0) < ALIKE_MEANS):
        return "Other than there, all starts end at one place."
    text = (
        "As there, the end depends on the start; the lowest here is that of "
        f"γ = {lowest_start(example):g}."
    )
    if away:
        text += (
            f" From {' and '.join(away)} J falls towards a rigid base and has no minimum on the "
            "way: where the simplex stops there is chance."
        )
    return text


def _map(example: Example) -> str:
    ours = ", ".join(f"{error:+.2f}" for error in map_errors(example))
    theirs = ", ".join(f"{error:g}" for error in MAP_ERRORS)
    return (
        f"MAP errors of k11, k22, k12: {ours} %; printed {theirs} %. Both are one draw of the "
        f"measurement: the posterior's own std is "
        + ", ".join(f"{100.0 * std:.1f}" for std in example.corrected.stds)
        + f" %. σ is {example.published.highest[3]:.1e} at the MAP draw, printed {MAP_SIGMA:.1e}: "
        "Eq. 11 sets each shape's largest component to 1, which has no variance; left in Eq. 9 it "
        "drives σ to zero, so it is dropped here; frequency and all other components of each found "
        "mode enter, as in Eq. 9, with no error beside SSI-cov's own and σ. The 95 % bound of σ is "
        f"{np.quantile(example.corrected.draws[:, 3], 0.95):.1e}."
    )


def _intervals(study: Study) -> list[str]:
    """Return, for each sign, whether the first seed's intervals hold the truth, and if not why."""
    seed = study.first.seed
    return [_intervals_of(each) for each in study.examples if each.seed == seed]


def _intervals_of(example: Example) -> str:
    covers = example.corrected.covers
    held = [name for name, inside in zip(SPRING_NAMES, covers, strict=True) if inside]
    missed = [name for name, inside in zip(SPRING_NAMES, covers, strict=True) if not inside]
    means = 100.0 * (example.corrected.draws[:, :3].mean(axis=0) - 1)
    head = (
        f"The truth is known here. Seed {example.seed}, {example.sign} sign: means of k11, k22, "
        f"k12 {_signed(means)} % off it, stds {_plain(100.0 * example.corrected.stds)} %; "
    )
    if not missed:
        return f"{head}the 90 % intervals of all three springs hold it."
    some = f"hold it for {_listed(held)}, not for" if held else "miss it for"
    return f"{head}the 90 % intervals {some} {_listed(missed)}. {_why_missed(example)}"


def _listed(names: Sequence[str]) -> str:
    """Return "a", "a and b" or "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _why_missed(example: Example) -> str:
    """Return how far the identified modes are from the truth, and what one of them does."""
    found = [mode for mode in example.modes if np.isfinite(mode.frequency)]
    far = max(found, key=lambda each: max(each.shape_deviation, each.frequency_deviation))
    what = "shape" if far.shape_deviation >= far.frequency_deviation else "frequency"
    text = (
        "At the truth the compared frequencies and shapes are off by "
        f"{example.deviation:.1f} of their SSI-cov standard deviations rms (1 if these were the "
        f"whole error), most the {what} of mode {far.label}, by "
        f"{max(far.shape_deviation, far.frequency_deviation):.1f}. "
    )
    if example.deviation > TOO_NARROW:
        text += "Eq. 9 takes them for the whole error, and Gaussian. "
    if example.left_out:
        text += (
            f"Of the modes left out in turn, it is mode {example.left_out} without which the peak "
            f"is nearest to it: {_errors_of(example.without)}. "
        )
    return (
        f"{text}pilewatch's own likelihood, of all paired modes, with floors and heavy tails, has "
        f"its peak at {_errors_of(example.own_peak)} off the truth."
    )


def _errors_of(peak: Peak) -> str:
    stds = 100.0 * np.sqrt(np.diag(peak.covariance))
    return f"{_signed(100.0 * (peak.ratios - 1))} % (stds {_plain(stds)} %)"


def _holds(peak: Peak) -> NDArray[np.bool_]:
    """Whether each 90 % interval of a peak contains the truth; shape (3,)."""
    return np.abs(peak.ratios - 1) <= GAUSSIAN_90 * np.sqrt(np.diag(peak.covariance))


def _signed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:+.1f}" for value in values)


def _plain(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


def _sampler_bias(example: Example) -> str:
    wider = example.published.stds / example.corrected.stds - 1
    figures = ", ".join(f"{100.0 * each:+.0f}" for each in wider)
    text = (
        "TMCMC as published makes one Metropolis step for each sample of a stage. The stds of k11, "
        f"k22 and k12 come out {figures} % against the corrected sampler's (importance sampling at "
        "the end, checked against a grid)"
    )
    if np.all(np.abs(wider) < ALIKE_MEANS):
        return f"{text}: here the two agree."
    if np.all(wider > 0):
        return f"{text}: on data as informative as these one step a stage leaves it too wide."
    return f"{text}."


def _correlation(example: Example) -> str:
    values = example.corrected.correlations
    ours = ", ".join(f"{each:.2f}" for each in values)
    peaks = n_peaks(example.corrected)
    text = (
        f"The posterior has {'a single peak' if peaks == 1 else f'{peaks} peaks'} and the "
        f"correlations k11-k22, k11-k12, k22-k12 are {ours}"
    )
    if np.all(values > STRONG):
        return f"{text}: strongly positive, as Figure 3 shows."
    if np.all(values > 0):
        return f"{text}: positive as in Figure 3, though not all strongly."
    return f"{text}: other than in Figure 3, not all are positive."


def _sign(study: Study) -> str:
    other = study.of("embedded-pile")
    if not other:
        return "Only the published sign of k12 was run."
    rms = {
        name: float(np.sqrt(np.mean(np.square(_percent_apart(example)))))
        for name, example in (("published", study.first), ("embedded", other[0]))
    }
    ratio = other[0].corrected.stds / study.first.corrected.stds
    text = (
        "The printed stiffness matrix is all positive; an embedded pile has k12 < 0 in the axes v "
        "(displacement), ψ = +dv/dz, z up. The model's frequencies at K0 differ from Table 1 by "
        f"{rms['published']:.1f} % rms with the matrix as printed, by {rms['embedded']:.1f} % with "
        "the pile's sign"
    )
    if rms["published"] < min(LIKE_TABLE_1, rms["embedded"]):
        text += ": taken literally it reproduces Table 1"
    figures = ", ".join(f"{each:.1f}" for each in ratio)
    misses = [e.sign for e in (study.first, other[0]) if not e.corrected.covers.all()]
    if misses:
        return (
            f"{text}. Stds with the pile's sign over those with the printed one: {figures}. How "
            "much less sharply the springs are known is not concluded from them: intervals of the "
            f"{' and the '.join(misses)} sign miss the truth."
        )
    if np.all(ratio > 1 + ALIKE_MEANS):
        return (
            f"{text}. With the pile's sign k11, k22 and k12 are known {figures} times less sharply."
        )
    return f"{text}. Stds with the pile's sign over those with the printed one: {figures}."


def over_seeds(examples: Sequence[Example]) -> list[tuple[str, str]]:
    """Return the figures over many seeds: a subject and its figures."""
    errors = np.abs([map_errors(example) for example in examples])
    covers = np.array([example.corrected.covers for example in examples])
    correlations = np.array([example.corrected.correlations for example in examples])
    starts = [lowest_start(example) for example in examples]
    counts = found_counts(examples)

    def three(values: np.ndarray, form: str = "{:.2f}") -> str:
        return " / ".join(form.format(value) for value in values)

    return [
        ("MAP error of k11 / k22 / k12, median [%]", three(np.median(errors, axis=0))),
        ("worst [%]", three(errors.max(axis=0))),
        ("90 % intervals that contain the truth", three(covers.sum(axis=0), "{:d}")),
        (
            "of pilewatch's own likelihood, Gaussian at its peak",
            three(np.array([_holds(example.own_peak) for example in examples]).sum(axis=0), "{:d}"),
        ),
        ("correlations, median", three(np.median(correlations, axis=0))),
        ("smallest correlation of any seed", f"{correlations.min():.2f}"),
        ("seeds with a single peak", str(sum(n_peaks(e.corrected) == 1 for e in examples))),
        (
            "lowest J from γ = 0.25 / 1 / 4 in so many seeds",
            three(np.array([starts.count(g) for g in (0.25, 1.0, 4.0)]), "{:d}"),
        ),
        ("found, modes 1 to 11", " ".join(str(counts[label]) for label in LABELS)),
    ]
