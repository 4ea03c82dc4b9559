"""A farm: whether it is followed in time, and what its turbines gain from each other.

    python -m tests.benchmarks farm [--part replay|simulated|pooling|all] [--turbines 20]
        [--first-seed 1] [--windows 3] [--speed 10] [--shards 2] [--keep FOLDER]
        [--farms 10] [--spread 0.02] [--common 0] [--modes paper|all]
        [--sign published|embedded-pile] [--newcomers 4]

`replay`: simulates turbines whose ln k spread by 2 %, the seventh with 15 % less k22, and replays
them at ten times real time through a session whose nodes are processes that share the turbines.
How late posteriors come, and what a window costs in CPU.

`simulated`: the first window of each of these turbines in one thread: CPU by step, and what pooling
makes of the posteriors.

`pooling`: farms of drawn posteriors. Every turbine has one window; or one has one and the others
six. How much less wrong its springs are with the others' help than by its own window alone, and
whether a turbine with 15 % less k22 is told, and no other.

What it gave, on a machine with nine to fifteen processes for its two cores:

    replay (seed 1): 60 of 60 windows in time, lag p50 18 s, p99 28 s; 3.9 s CPU a window with the
        processes' start: 153 turbines a core at real time.
    pooling (seeds 6101..6108; told from .9 on where it is .8 now): the median error of a turbine
        with one window falls by 22 % where all have one (k11 k22 k12: 23 20 33 %; of 160 turbines),
        by 21 % where the others have six (32 turbines); pooled 90 % intervals hold .93 .91 .93. Of
        turbines with .85 times the k22 that they would have had 7 of 8 told, the eighth with
        probability .88; of the 152 others none. Other farms (seeds 1..6; 6401..6403) 25 and 47 %;
        32 %, 3 of 3 told and none of 57. Who knew mean and spread would gain 40 %; half the spread
        beforehand (A) changes nothing.
        With the embedded-pile sign (seeds 6201..6205), by 60 % (52 63 60 %; 100 turbines), by 77 %
        where the others have six (20); 4 of 5 told, the fifth with .75, and none of the 95 others.
    simulated (seed 1): with all modes .20 .28 .64 % alone and .25 .50 .48 % pooled, with the
        paper's eleven .31 .75 .67 % and .34 1.15 .71 %; turbine 7 told, no other. Nothing is gained
        there: simulated towers share the model's structure, their errors are less than half of what
        the posteriors' floors allow for, and a farm that believes them lends too much. With the
        embedded-pile sign (seed 6301) half is gained: 2.5 4.6 5.1 % alone, 1.3 2.4 2.1 % pooled;
        with the eleven 3.3 3.5 4.1 % and 1.1 1.1 1.5 %; turbine 7 told, no other.
    CPU a window: 4.0 s, of which 1.8 s for filtering blocks of one second one by one; .5 s since
        they are filtered by tens, so 2.7 s; .8 s identification, 1.3 s updating.
"""

import argparse
import tempfile
from pathlib import Path

from tests.benchmarks._farm_pooling import FarmCase, print_pooling
from tests.benchmarks._farm_replay import ReplayCase, print_replay, recording_of
from tests.benchmarks._farm_simulated import print_simulated

PARTS = ("replay", "simulated", "pooling", "all")


def main(arguments: list[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks farm")
    parser.add_argument("--part", choices=PARTS, default="all")
    parser.add_argument("--farms", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--turbines", type=int, default=20)
    parser.add_argument("--spread", type=float, default=0.02)
    parser.add_argument("--common", type=float, default=0.0)
    parser.add_argument("--modes", choices=("paper", "all"), default="paper")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--newcomers", type=int, default=4)
    parser.add_argument("--windows", type=int, default=3)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="folder where the recording is kept")
    chosen = parser.parse_args(arguments)
    if chosen.part in ("replay", "simulated", "all"):
        _of_recording(chosen)
    if chosen.part in ("pooling", "all"):
        seeds = range(chosen.first_seed, chosen.first_seed + chosen.farms)
        case = FarmCase(
            chosen.turbines, chosen.spread, chosen.common, chosen.modes, sign=chosen.sign
        )
        print_pooling(case, seeds, chosen.newcomers)


def _of_recording(chosen: argparse.Namespace) -> None:
    case = ReplayCase(
        turbines=chosen.turbines,
        windows=chosen.windows,
        seed=chosen.first_seed,
        speed=chosen.speed,
        shards=chosen.shards,
        sign=chosen.sign,
    )
    with tempfile.TemporaryDirectory() as folder:
        recording = recording_of(case, chosen.keep or Path(folder))
        if chosen.part in ("replay", "all"):
            print_replay(case, recording)
        if chosen.part in ("simulated", "all"):
            print_simulated(recording)
