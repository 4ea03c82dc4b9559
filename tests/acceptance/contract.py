"""What the product publishes of the cached hours and of six live windows, and its reference.

The reference is the same evidence sampled twenty times as long. It is committed; a deliberate
change of numbers renews it in the commit that says why:

    python -m tests.acceptance.contract
"""

import json
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.settings import OmaSettings
from pipeline.updating import posterior_message
from pipeline.updating.samplers.importance import ImportanceSettings
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.acceptance.cached_day import cached_day
from tests.outside.modal_data import LAYOUT, Truth
from tests.outside.model import NOMINAL, averaged
from tests.outside.records import record

REFERENCE = Path(__file__).with_name("reference.json")
NAMES = ("k11", "k22", "k12")
SEED, REFERENCE_SEED = 1, 2
LONG = ImportanceSettings(effective_draws=20_000, draws=40_000)
LIVE_THETA = NOMINAL * [1.1, 0.92, 0.97]
LIVE_SEED = 20261123
LIVE_WINDOWS = 6


def cases() -> Mapping[str, UpdatingSettings]:
    """Which cached day is held with which settings; one of them is the product's default."""
    return {"known": UpdatingSettings()}


@dataclass(frozen=True, slots=True, eq=False)
class Published:
    """The springs of one posterior, as ratios to nominal; arrays are (3,) of k11, k22, k12."""

    median: FloatArray
    std: FloatArray
    """Of the draws [-]."""
    width: FloatArray
    """p95 − p05 [-]."""
    correlation: FloatArray
    """(3,) of k11 with k22, k11 with k12, k22 with k12 [-]."""
    sigma: float
    """95 % bound of σ [-]."""
    reduced_chi_square: float
    paired_share: float

    @classmethod
    def of(cls, posterior: FoundationPosterior) -> "Published":
        """Read what a message says."""
        springs = [posterior.parameter(name) for name in NAMES]
        nominal = np.array([each.nominal for each in springs])
        return cls(
            median=np.array([each.median for each in springs]) / nominal,
            std=posterior.draws[:, :3].std(axis=0) / nominal,
            width=np.array([each.p95 - each.p05 for each in springs]) / nominal,
            correlation=posterior.correlation[[0, 0, 1], [1, 2, 2]],
            sigma=posterior.parameter("sigma").p95,
            reduced_chi_square=posterior.reduced_chi_square,
            paired_share=posterior.paired_share,
        )

    def as_json(self) -> dict[str, Any]:
        """Six digits of everything."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return {name: np.asarray(each).round(6).tolist() for name, each in values.items()}

    @classmethod
    def from_json(cls, kept: Mapping[str, Any]) -> "Published":
        """Read what `as_json` wrote."""
        return cls(**{k: np.array(v) if isinstance(v, list) else v for k, v in kept.items()})


@cache
def model() -> ModalModel:
    """The shipped turbine at the outside model's sensors."""
    return ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)


def last_posterior(
    updating: FoundationUpdater, estimates: Sequence[ModalEstimate]
) -> FoundationPosterior:
    """The posterior after all the windows."""
    state = updating.initial_state()
    for estimate in estimates:
        state, _ = updating.accumulated(state, estimate)
    _, posterior = updating.refreshed(state, estimates[-1])
    assert isinstance(posterior, FoundationPosterior), posterior
    return posterior


def of_day(kind: str, settings: UpdatingSettings, *, seed: int = SEED) -> list[FoundationPosterior]:
    """One posterior for each cached hour, each with draws of its own."""
    posteriors = []
    for number, hour in enumerate(cached_day(kind)):
        updating = FoundationUpdater(model(), LAYOUT, settings, seed=100 * seed + number)
        posteriors.append(last_posterior(updating, hour.estimates))
    return posteriors


def live_truth() -> Truth:
    """The structure behind the live hour, as it is described."""
    return Truth(LIVE_THETA, description=averaged())


def live_estimates() -> list[ModalEstimate]:
    """Six windows of the outside model's time histories, identified as in a run."""
    made = record(live_truth(), LIVE_WINDOWS, np.random.default_rng(LIVE_SEED))
    node = IdentificationNode(OmaSettings())
    messages: list[Any] = list(node.handle(made.layout))
    for block in made.blocks():
        messages += node.handle(block)
    return [each for each in messages if isinstance(each, ModalEstimate)]


def of_windows(
    estimates: Sequence[ModalEstimate], settings: UpdatingSettings, *, seed: int = SEED
) -> list[FoundationPosterior]:
    """The posterior after each window."""
    updating = FoundationUpdater(model(), LAYOUT, settings, seed=seed)
    return [last_posterior(updating, estimates[: n + 1]) for n in range(len(estimates))]


def sampled_long(settings: UpdatingSettings) -> UpdatingSettings:
    """The same with twenty times the draws."""
    return replace(settings, sampling=replace(settings.sampling, importance=LONG))


def reference(section: str) -> list[Published]:
    """Read one section of the committed reference."""
    kept = json.loads(REFERENCE.read_text(encoding="utf-8"))
    return [Published.from_json(each) for each in kept["sections"][section]]


def write_reference() -> None:
    """Compute the reference again; some minutes."""
    posterior_message.MOST_DRAWS = LONG.draws  # their std is the reference's, not a thousand's
    sections = {}
    for kind, settings in cases().items():
        sections[kind] = of_day(kind, sampled_long(settings), seed=REFERENCE_SEED)
    live, default = live_estimates(), cases()["known"]
    sections["live"] = of_windows(live, sampled_long(default), seed=REFERENCE_SEED)
    kept = {
        "command": "python -m tests.acceptance.contract",
        "commit": _commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{platform.machine()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}",
        "live": {"modes": [len(each.modes) for each in live]},
        "sections": {
            name: [Published.of(each).as_json() for each in posteriors]
            for name, posteriors in sections.items()
        },
    }
    REFERENCE.write_text(_lines(kept), encoding="utf-8")


def _lines(kept: Mapping[str, Any]) -> str:
    """JSON with one posterior a line."""
    whole = json.dumps(kept, indent=1)
    short = {
        json.dumps(each, indent=1): json.dumps(each)
        for each in _posteriors(kept["sections"].values())
    }
    for long, line in short.items():
        whole = whole.replace(long.replace("\n", "\n   "), line)
    return whole + "\n"


def _posteriors(sections: Iterable[list[dict[str, Any]]]) -> Iterable[dict[str, Any]]:
    for section in sections:
        yield from section


def _commit() -> str:
    head = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(head, capture_output=True, text=True, check=False).stdout.strip()


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        write_reference()
    sys.stdout.write(f"{REFERENCE}\n")
