"""Receivers that answer oddly: `python -m tests.benchmarks alarms [--answers N] [--seed S]`.

A web server, a mail server and a broker give N odd answers each: malformed, cut, endless, late,
redirects to another host, refusals of single recipients. Counted: messages that count as delivered
without a confirmation (silent), channels that end (dead), connections to another host (foreign).
"""

import argparse
import logging
import os
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.benchmarks._results import keep
from tests.pipeline.monitoring.alarms.fuzz import PROTOCOLS, fuzzed


def main(arguments: Sequence[str]) -> None:
    """Run each protocol, print a table, write the results."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks alarms")
    parser.add_argument("--answers", type=int, default=1000, help="odd answers a protocol")
    parser.add_argument("--seed", type=int, default=9001)
    parser.add_argument("--only", choices=PROTOCOLS)
    chosen = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    os.environ["HOOK_TOKEN"] = "the-secret-token"
    outcomes = []
    for protocol in [chosen.only] if chosen.only else PROTOCOLS:
        with tempfile.TemporaryDirectory() as folder:
            outcome = fuzzed(protocol, chosen.answers, chosen.seed, Path(folder))
        outcomes.append(asdict(outcome))
        print(outcome, flush=True)
    command = f"python -m tests.benchmarks alarms --answers {chosen.answers} --seed {chosen.seed}"
    if not chosen.only:
        keep(
            "alarms",
            {"outcomes": outcomes},
            command=command,
            seeds=[chosen.seed],
            depends=["pipeline/monitoring/alarms"],
        )
