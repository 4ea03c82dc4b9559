"""A posterior in the figures of `summary.json`: ratios to nominal, the truth where it is known."""

from pipeline.messages import FoundationPosterior, FoundationTruth, ParameterSummary
from sensors.json_values import Json, fields_of, known, with_nulls

STIFFNESSES = ("k11", "k22", "k12")
SKEW_SHOWS = 0.2  # half width from which a posterior's skewness shows [-]
ROUGH = 0.25  # half width from which a spring is known only roughly [-]
MEDIAN_AND_INTERVAL = ("median", "p05", "p95")


def posterior_summary(posterior: FoundationPosterior, truth: FoundationTruth | None = None) -> Json:
    """The `posterior` entry: k11, k22, k12, sigma, correlation, ess, rhat; unknown values None.

    Parameters
    ----------
    posterior : FoundationPosterior
        To be summarised.
    truth : FoundationTruth, optional
        The true springs, where they are known.

    Notes
    -----
    figures
        Of the structure that are uncertain as well, by name; {} where none is.
    correlation
        3 × 3, order k11, k22, k12.
    ess, rhat
        The smallest and the largest over the parameters.
    change_probability
        That the modes have changed since the last event.
    structure
        "exact" or "uncertain".
    budget
        Figure → share of the variance of ln k11, ln k22, ln k12; {} where exact.
    alternatives
        Structure → probability; {} where there is one.
    unpredicted_share
        Of the modes, each predicted by the others.
    relative
        Springs over those before the last event; {} without one.
    """
    summary: Json = {
        name: stiffness_summary(
            posterior.parameter(name), None if truth is None else getattr(truth, name)
        )
        for name in STIFFNESSES
    }
    summary["sigma"] = fields_of(posterior.parameter("sigma"), "median", "p95")
    summary["figures"] = {each.name: figure_summary(each) for each in posterior.figures}
    summary["correlation"] = with_nulls(posterior.correlation.tolist())
    summary |= fields_of(posterior, "ess", "rhat", "change_probability", "structure")
    summary["budget"] = {each.name: fields_of(each, *STIFFNESSES) for each in posterior.budget}
    summary["alternatives"] = {each.name: each.probability for each in posterior.alternatives}
    summary["unpredicted_share"] = known(posterior.unpredicted_share)
    summary["relative"] = {
        each.name: fields_of(each, *MEDIAN_AND_INTERVAL) for each in posterior.relative
    }
    return summary


def stiffness_summary(parameter: ParameterSummary, truth: float | None = None) -> Json:
    """Return one stiffness in its unit and as ratios to nominal; `truth` in the same unit."""
    median, low, high = ratios(parameter)
    return {
        **fields_of(parameter, "unit", *MEDIAN_AND_INTERVAL),
        "ratio_median": median,
        "ratio_p05": low,
        "ratio_p95": high,
        "truth_ratio": None if truth is None else truth / parameter.nominal,
    }


def figure_summary(figure: ParameterSummary) -> Json:
    """Return a figure of the structure: as a factor to the described one, scour in metres."""
    return fields_of(figure, "unit", *MEDIAN_AND_INTERVAL, "contraction")


def empty_summary() -> Json:
    """Return the same entry where no window gave a posterior: every value None."""
    nothing = (
        *MEDIAN_AND_INTERVAL,
        *(f"ratio_{each}" for each in MEDIAN_AND_INTERVAL),
        "truth_ratio",
    )
    units = {"k11": "N/m", "k22": "N·m/rad", "k12": "N/rad"}
    summary: Json = {name: {"unit": unit, **dict.fromkeys(nothing)} for name, unit in units.items()}
    summary["sigma"] = {"median": None, "p95": None}
    summary.update(figures={}, correlation=None, ess=None, rhat=None)
    summary["change_probability"] = None
    summary.update(structure=None, budget={}, alternatives={}, unpredicted_share=None, relative={})
    return summary


def ratios(spring: ParameterSummary) -> tuple[float, float, float]:
    """Median, 5 % and 95 % quantile over nominal [-]; ordered also for a negative nominal."""
    low, high = sorted((spring.p05 / spring.nominal, spring.p95 / spring.nominal))
    return spring.median / spring.nominal, low, high


def plus_minus(spring: ParameterSummary) -> str:
    """Return "1.003 ± 0.007": median and half the 90 % interval, over nominal.

    Of a wide posterior, which is skew, the interval: "0.26 to 2.76".
    """
    median, low, high = ratios(spring)
    half = (high - low) / 2
    return f"{median:.3f} ± {half:.3f}" if half < SKEW_SHOWS else f"{low:.2f} to {high:.2f}"


def widest_half_width(posterior: FoundationPosterior) -> float:
    """Return half the widest 90 % interval of a spring, over its median [-]."""
    springs = (ratios(posterior.parameter(name)) for name in STIFFNESSES)
    return max((high - low) / 2 / median for median, low, high in springs)
