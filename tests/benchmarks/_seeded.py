"""What benchmarks over a range of seeds share: their options, and figures printed and kept."""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from typing import Any

from tests.benchmarks._results import keep


def seeded_options(name: str, *, first_seed: int, records: int) -> ArgumentParser:
    """Options of a benchmark that draws a record a seed."""
    parser = ArgumentParser(prog=f"python -m tests.benchmarks {name}")
    parser.add_argument("--first-seed", type=int, default=first_seed)
    parser.add_argument("--records", type=int, default=records)
    parser.add_argument("--keep", action="store_true", help="write the result")
    return parser


def seeds_of(options: Namespace) -> range:
    """A seed a record."""
    return range(options.first_seed, options.first_seed + options.records)


def report(
    name: str,
    figures: Mapping[str, Any],
    options: Namespace,
    *,
    seeds: Sequence[int],
    depends: str = "pipeline/oma",
) -> None:
    """Print a benchmark's figures; keep them where asked, with the command of these options."""
    for title, value in figures.items():
        print(f"{title:20s} {_in_words(value)}")
    if options.keep:
        numbers = {
            key: value for key, value in vars(options).items() if not isinstance(value, bool)
        }
        given = " ".join(f"--{key.replace('_', '-')} {value}" for key, value in numbers.items())
        keep(
            name,
            figures,
            command=f"python -m tests.benchmarks {name} {given} --keep",
            seeds=seeds,
            depends=(depends, f"tests/benchmarks/{name}.py"),
        )


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {each:.3g}" for key, each in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)
