"""The same samples are identified once for all tests that ask for it, in all processes of a run.

For tests of what becomes of a window (its fate, its order, its channels, its posterior), which send
the same samples again under other stamps, in another order, from a file or after a restart. What
the identification itself returns is tested elsewhere, without this. Windows and their dear parts
are kept by the content of all that they are given: another bit is another answer.

The reduced models of a structure and its figures, which every session needs, are kept likewise for
all tests; those of what such a model is build their own. So is the posterior of a window, by the
structure, the settings and all that the updating remembers.
"""

import fcntl
import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.oma import identification, window_identification
from pipeline.updating.state import UpdatingState
from pipeline.updating.structural import inference
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.updater import FoundationUpdater
from sensors.dynamics.modal_model import ModalModel

STEPS = {  # functions of arrays and settings alone, where they are called: a window, its dear parts
    window_identification: ("identify",),
    identification: ("modes_of_covariances", "concluded"),
}
REFRESHED = FoundationUpdater._refreshed


@pytest.fixture(scope="session")
def identified_answers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of what was identified in this run of the suite, by any of its processes."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base  # what processes share
    folder = base / "identified"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session", autouse=True)
def structures_once(identified_answers: Path) -> Iterator[None]:
    """Seconds for each of a turbine and its sensors."""
    with pytest.MonkeyPatch.context() as patch:
        made = partial(_remembered, identified_answers, inference.FigureModel)
        patch.setattr(inference, "FigureModel", made)
        yield


@pytest.fixture(scope="module")
def identified_once(identified_answers: Path) -> Iterator[None]:
    """For `pytestmark = pytest.mark.usefixtures("identified_once")`."""
    with remembering(identified_answers):
        yield


@pytest.fixture
def identified_before(identified_answers: Path) -> Iterator[None]:
    """The same for one test, after the fixtures of its module."""
    with remembering(identified_answers):
        yield


@contextmanager
def remembering(answers: Path) -> Iterator[None]:
    """Take from the folder what was identified before, and add what was not; also within another
    of these."""
    with pytest.MonkeyPatch.context() as patch:
        for module, names in STEPS.items():
            for name in names:
                step = getattr(module, name)
                if not isinstance(step, partial):
                    patch.setattr(module, name, partial(_remembered, answers, step))
        if FoundationUpdater._refreshed is REFRESHED:
            patch.setattr(FoundationUpdater, "_refreshed", _refreshed_by(answers))
        yield


def _refreshed_by(answers: Path) -> Callable[..., Any]:
    """The refresh of a posterior, of the same structure and state once."""

    def refreshed(updater: FoundationUpdater, state: UpdatingState, estimate: ModalEstimate) -> Any:
        model, compute = updater._forward, partial(REFRESHED, updater, state, estimate)
        structure: object = model
        if isinstance(model, ModalModel):
            structure = (model.description, model.layout, model.highest_frequency,
                         model.theta_reference)  # fmt: skip
        elif not is_dataclass(model):  # what it is made of is not known
            return compute()
        settings = updater._layout, updater.settings, updater._seed, updater._population
        made_of = structure, _of_inference(updater._inference), *settings
        return _kept(answers, ("posterior", made_of, updater.saved(state), estimate), compute)

    return refreshed


def _of_inference(inference: object) -> object:
    """What an inference was itself given, which need not be what its updater was."""
    if not isinstance(inference, JointInference):
        return type(inference).__qualname__  # the updater makes it of what it was given
    fits = [
        (alternative, fit._draws, fit.likelihood, fit._pairing, fit.settings, fit.tolerance,
         fit.sensors.figures, fit.coordinates.figures, fit.coordinates.origin,
         fit.coordinates.prior_precision, fit.coordinates.level_std)
        for alternative, fit in inference.fits
    ]  # fmt: skip
    return inference.structure, inference.layout, inference.prior, inference._highest_sigma, fits


def _remembered(answers: Path, step: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """The answer to these arguments, computed the first time."""
    asked = (step.__qualname__, arguments, tuple(sorted(named.items())))
    return _kept(answers, asked, partial(step, *arguments, **named))


def _kept(answers: Path, asked: object, compute: Callable[[], Any]) -> Any:
    """What is kept under all that was asked, computed the first time."""
    file = answers / blake2b(repr(_content(asked)).encode()).hexdigest()[:32]
    with file.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if file.exists():
            return pickle.loads(file.read_bytes())
        answer = compute()
        part = file.with_suffix(f".{os.getpid()}")
        part.write_bytes(pickle.dumps(answer))
        part.rename(file)
        return answer


def _content(argument: Any) -> object:
    """What an argument holds, in values whose text has every bit."""
    if isinstance(argument, np.ndarray):
        return argument.shape, argument.dtype.str, blake2b(argument.tobytes()).hexdigest()
    if isinstance(argument, list | tuple):
        return tuple(map(_content, argument))
    if is_dataclass(argument):
        held = (getattr(argument, each.name) for each in fields(argument))
        return type(argument).__qualname__, tuple(map(_content, held))
    return argument
