"""A farm: what its turbines gain from each other.

    python -m tests.benchmarks farm [--part pooling] [--farms 10] [--first-seed 1]
        [--turbines 20] [--spread 0.02] [--common 0] [--modes paper|all] [--newcomers 4]

`pooling`: farms of drawn posteriors. Every turbine has one window; or one has one and the others
six. How much less wrong its springs are with the others' help than by its own window alone, and
whether a turbine with 15 % less k22 is told, and no other.
"""

import argparse

from tests.benchmarks._farm_pooling import FarmCase, print_pooling

PARTS = ("pooling",)


def main(arguments: list[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks farm")
    parser.add_argument("--part", choices=PARTS, default="pooling")
    parser.add_argument("--farms", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--turbines", type=int, default=20)
    parser.add_argument("--spread", type=float, default=0.02)
    parser.add_argument("--common", type=float, default=0.0)
    parser.add_argument("--modes", choices=("paper", "all"), default="paper")
    parser.add_argument("--newcomers", type=int, default=4)
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.farms)
    case = FarmCase(chosen.turbines, chosen.spread, chosen.common, chosen.modes)
    print_pooling(case, seeds, chosen.newcomers)
