"""Figures of a run in words. Commands use it before numpy is imported: nothing heavy here."""

import re
from collections import Counter

FIGURE_KEY = re.compile(r"\b[a-z]+(?:_[a-z]+)+(?= lies\b)")
"""A figure's key as a warning names it."""


WHAT_TO_DO = (
    "what to do about each warning: docs/pages/your-turbine.md, When the posterior is not trusted"
)
FIGURES_NOTE = (
    "unit -: factor to the description, of a gain its departure; m and deg: departure from the "
    "description; kg: mass added at the transition; RNA: rotor and nacelle"
)
"""How the figures of a structure and its sensors are to be read."""


def count_noun(number: int, noun: str) -> str:
    """Return "1 window", "2 windows"."""
    return f"{number} {noun}" + "s" * (number != 1)


def codes_in_words(codes: Counter[str]) -> str:
    """Return how often each code, the most frequent first."""
    return ", ".join(f"{count} × {code}" for code, count in codes.most_common()) or "none"


def in_hertz(frequency: float) -> str:
    """Return a frequency [Hz] with three digits: "0.630", "17.0"."""
    return f"{frequency:#.3g}".rstrip(".")


def block_numbers(first: int, end: int) -> str:
    """Return "block 3 is" or "blocks 3 to 5 are"."""
    return f"block {first} is" if end == first + 1 else f"blocks {first} to {end - 1} are"


def figure_name(name: str) -> str:
    """Return a figure's key in words: "RNA mass", "gain z80-fa"."""
    return name.replace("_", " ").replace("rna ", "RNA ")


def figures_named(text: str) -> str:
    """Return a sentence with the keys of figures in words: "RNA mass lies …"."""
    return FIGURE_KEY.sub(lambda found: figure_name(found[0]), text)
