"""Figures printed in the publication. Source: [foundation-updating] Tables 1 and 2."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PublishedMode:
    """A row of Table 1."""

    label: str
    direction: str
    """SS or FA."""
    model_frequency: float
    """Frequency of the model at K0 [Hz]."""
    identified_frequency: float
    """Identified frequency [Hz]."""
    mac: float
    """MAC of identified and model shape [-]."""


@dataclass(frozen=True, slots=True)
class PublishedDescent:
    """A row of Table 2's deterministic half: errors of the end point [%] and J there."""

    start: float
    """Start γ, ratio to K0 [-]."""
    errors: tuple[float, float, float]
    """Errors of k11, k22, k12 [%]."""
    objective: float
    """Objective J at the end point [-]."""


TABLE_1 = (
    PublishedMode("1", "SS", 0.1573, 0.1567, 0.038),
    PublishedMode("2", "FA", 0.1587, 0.1586, 0.999),
    PublishedMode("3", "FA", 0.6284, 0.6279, 1.000),
    PublishedMode("4", "SS", 1.0898, 1.0890, 0.309),
    PublishedMode("5", "FA", 1.1064, 1.1054, 1.000),
    PublishedMode("6", "FA", 1.8298, 1.8257, 0.988),
    PublishedMode("7", "FA", 2.5729, 2.5854, 0.998),
    PublishedMode("8", "FA", 3.8598, 3.8637, 1.000),
    PublishedMode("9", "FA", 5.7920, 5.7667, 0.999),
    PublishedMode("10", "FA", 10.2769, 10.2588, 1.000),
    PublishedMode("11", "FA", 12.1961, 12.2060, 0.996),
)
TABLE_2 = (
    PublishedDescent(0.25, (5.91, -47.6, -16.7), 2.027),
    PublishedDescent(1.0, (-8.84, 11.32, -7.09), 1.66),
    PublishedDescent(4.0, (222.79, 336.52, 366.4), 1.84),
)
MAP_ERRORS = (2.83, 3.9, 5.42)  # of k11, k22, k12, Table 2 [%]
MAP_SIGMA = 3.24e-6  # Table 2 [-]
SAMPLES = 100_000  # of TMCMC, section 4.2
LABELS = tuple(mode.label for mode in TABLE_1)
