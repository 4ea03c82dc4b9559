"""Figures of a run in words. Commands use it before numpy is imported: nothing heavy here."""

from collections import Counter


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
