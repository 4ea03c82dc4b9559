"""What recorded sessions report of a turbine's figures: `pilewatch calibrate`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.messages import (
    HALF_INTERVAL,
    FoundationEvent,
    FoundationPosterior,
    ModalEstimate,
    QualityWarning,
    UnitOrigin,
    WindowRejected,
)
from pipeline.nodes.operating_state import usable_estimate
from pipeline.recording.reader import read_messages
from pipeline.scenario import Scenario
from pipeline.sources.recorded_stream import recordings_in
from pipeline.sources.sources import Source, replayed_with_structure
from pipeline.state.phrases import count_noun
from pipeline.updating.acceptance import AcceptanceSettings
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import EstimateRefused, SeenWindow, mode_observations
from pipeline.updating.prior import PARAMETER_NAMES
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference, prior_stds
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.periods.calibration import (
    CalibratedAlternative,
    DesignSprings,
    calibrated,
    calibration_of,
    evidence_by_level,
)
from pipeline.updating.structural.refresh import JointRefresh, joint_refresh
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import one_blas_thread
from sensors.errors import InputError
from sensors.json_values import Json
from sensors.settings import toml_string
from sensors.structure.calibration import Calibration
from sensors.structure.description import parse_turbine, turbine_text

FEWEST_TO_CALIBRATE = 6
SECTION = "[calibration]"


@dataclass(frozen=True, slots=True, eq=False)
class TurbineCalibration:
    """A calibration and what it was made from."""

    calibration: Calibration
    alternatives: tuple[CalibratedAlternative, ...]
    levels: tuple[float, ...]
    """Mean water level of each group of windows, above the model's [m]."""
    n_windows: int
    n_refused: int
    n_level_unknown: int
    """Windows whose water level nothing reported; unless it is all of them, they are in no
    group."""
    text: str
    """Of the description with the calibration, as TOML."""

    @property
    def level_known(self) -> bool:
        """Whether anything reported the water's level."""
        return self.n_level_unknown < self.n_windows

    @property
    def best(self) -> CalibratedAlternative:
        """The likeliest alternative."""
        return self.alternatives[0]

    def as_json(self) -> Json:
        """Return the entries of `calibrate --json`."""
        best = self.best
        logs, stds = best.log_springs
        medians, halves = best.departures
        figures: list[Json] = [
            {
                "name": name,
                "prior_std": std,
                "median": std * float(median),
                "std": std * float(half),
            }
            for name, std, median, half in zip(
                best.names, self.calibration.stds, medians, halves, strict=True
            )
        ]
        springs: Json = {
            name: {
                "median": float(np.exp(log)),
                "p05": float(np.exp(log - HALF_INTERVAL * std)),
                "p95": float(np.exp(log + HALF_INTERVAL * std)),
            }
            for name, log, std in zip(PARAMETER_NAMES, logs, stds, strict=True)
        }
        return {
            "source": self.calibration.source,
            "windows": self.n_windows,
            "windows_refused": self.n_refused,
            "water_levels_m": list(self.levels),
            "alternatives": {each.name: each.weight for each in self.alternatives},
            "springs_over_nominal": springs,
            "figures": figures,
            "not_separated": [
                {"figures": dict(each.parts), "springs_moved": list(each.moved)}
                for each in best.unseparated
            ],
        }


def calibrate_turbine(
    files: Sequence[Path],
    *,
    scenario: str | None = None,
    design: DesignSprings | None = None,
) -> TurbineCalibration:
    """Infer a structure's figures from the modal estimates of recorded sessions.

    Parameters
    ----------
    files : sequence of Path
        Recordings of one turbine with the same sensors, in any order; folders too.
    scenario : str, optional
        Name or path; None: the first recording's own.
    design : DesignSprings, optional
        What the foundation's design says of its springs.

    Raises
    ------
    InputError
        If a recording has no estimates, another turbine or other sensors, or an event in it; if
        its last posterior is not trusted, with the scenario that it was made with; if the structure
        is taken as exact; if too few windows can be used; if the modes, a figure or a sensor are
        not as described.

    Notes
    -----
    What the files state is read before anything is fitted: a fit takes minutes.
    """
    sources = [replayed_with_structure(file, scenario) for file in files]
    first = sources[0]
    _require_one_structure(first.scenario)
    for source in sources[1:]:
        _require_alike(first, source)
    structure = replace(first.scenario.structure, calibration=None)
    if first.scenario.updating.structure.exact:
        raise InputError(
            f"{files[0]}: its structure is taken as exact ([structure] uncertain), so no "
            "figure is left to calibrate; give a --scenario without it"
        )
    water = 0.0 if structure.water is None else structure.water.level
    windows, refused = _windows(sources, water, judged=scenario is None)
    if len(windows) < FEWEST_TO_CALIBRATE:
        raise InputError(
            f"{files[0]}: {len(windows)} windows can be used, {refused} cannot; a calibration "
            f"takes at least {FEWEST_TO_CALIBRATE}, better a week of tides"
        )
    with_level = sum(window.level_known for window in windows)
    if 0 < with_level < FEWEST_TO_CALIBRATE:
        raise InputError(
            f"{files[0]}: {with_level} of {len(windows)} windows have a water level; a calibration "
            f"takes at least {FEWEST_TO_CALIBRATE} that have one, or sessions without any"
        )
    with one_blas_thread():
        inference = joint_inference(
            structure, first.layout, first.scenario.updating, seed=first.scenario.seed
        )
        assert inference is not None  # an exact structure was refused
        if design is not None:
            inference = inference.with_springs(design.belief)
        return _calibrated(first, inference, windows, refused, files)


def _calibrated(
    source: Source,
    inference: JointInference,
    windows: Sequence[SeenWindow],
    refused: int,
    files: Sequence[Path],
) -> TurbineCalibration:
    settings = source.scenario.updating
    empty = ModalEvidence(
        channels=source.layout.channel_names,
        joint_covariance=settings.likelihood.joint_covariance,
    )
    whole, levels = evidence_by_level(windows, empty)
    generator = np.random.default_rng(source.scenario.seed)
    found = joint_refresh(inference, whole, (), generator, guards=settings.guards)
    alternatives = calibrated(_as_described(found, files[0], settings.guards).result, levels)
    if not alternatives:
        raise InputError(f"{files[0]}: the windows of single water levels pair no mode")
    names = ", ".join(file.name for file in files)
    fit = inference.fits[0][1]
    calibration = calibration_of(
        alternatives,
        prior_stds(inference.prior, fit.sensors),
        springs_sign=source.scenario.structure.foundation.sign,
        source=f"{names}: {_groups(len(windows), [each for _, each in levels])}",
    )
    return TurbineCalibration(
        calibration=calibration,
        alternatives=alternatives,
        levels=tuple(rise for rise, _ in levels),
        n_windows=len(windows),
        n_refused=refused,
        n_level_unknown=sum(not window.level_known for window in windows),
        text=with_section(description_text(source.scenario), calibration),
    )


def _groups(n_windows: int, groups: Sequence[ModalEvidence]) -> str:
    """Return how many of the windows stand in groups by water level; too small ones are none."""
    grouped = sum(each.n_windows for each in groups)
    together = f"{grouped} of them in {count_noun(len(groups), 'group')} by water level"
    return f"{count_noun(n_windows, 'window')}, {together}"


def _as_described(
    found: JointRefresh | None, file: Path, guards: AcceptanceSettings
) -> JointRefresh:
    """Raises InputError where modes, figures or a sensor are not as the description has them."""
    if found is None or found.refusal is not None:
        reason = (
            "no mode has a partner"
            if found is None or found.refusal is None
            else found.refusal.text
        )
        raise InputError(f"{file}: the modes are not this structure's: {reason}")
    if found.best.fit.is_rough:
        raise InputError(
            f"{file}: the modes miss the description by more than its figures explain; correct "
            "the description first (`pilewatch update` reports the misfit of every mode)"
        )
    if found.fault is not None:
        raise InputError(
            f"{file}: a sensor is not as its layout states ({found.fault.text}); correct the "
            "layout first"
        )
    if doubts := distrust(found, guards):
        raise _contradicted(file, doubts)
    return found


def _windows(
    sources: Sequence[Source], water_level: float, *, judged: bool
) -> tuple[list[SeenWindow], int]:
    """Usable windows of all sources in the order of time, each once, and how many were refused.

    judged   whether the recorded posteriors are of the structure that is calibrated
    """
    found: dict[tuple[UnitOrigin, ...] | int, SeenWindow] = {}
    refused = 0
    for source in sources:
        n_before = len(found) + refused
        for estimate in _estimates(source, judged=judged):
            identity = estimate.origins or estimate.start_ns  # older recordings have no origins
            if identity in found:
                continue
            window = _seen(estimate, source, water_level)
            if window is None:
                refused += 1
            else:
                found[identity] = window
        if len(found) + refused == n_before:
            raise InputError(
                f"{source.recording}: it has no modal estimates of its own; `pilewatch run "
                f"--source replay:{source.recording}` writes a session with them"
            )
    return sorted(found.values(), key=lambda window: window.start_ns), refused


def _estimates(source: Source, *, judged: bool) -> list[ModalEstimate]:
    """Return the first turbine's estimates.

    Raises InputError where an event was recorded, or, `judged`, where the last posterior is not
    trusted.
    """
    assert source.recording is not None
    turbine, found = source.layout.turbine, []
    last: FoundationPosterior | None = None
    for file in recordings_in(source.recording):
        for message in read_messages(file, (ModalEstimate, FoundationEvent, FoundationPosterior)):
            if message.turbine != turbine:
                continue
            if isinstance(message, FoundationEvent):
                raise InputError(
                    f"{file}: its structure changed in window {message.window} ({message.kind}); "
                    "calibrate with sessions in which it stayed the same"
                )
            if isinstance(message, ModalEstimate):
                found.append(message)
            if isinstance(message, FoundationPosterior):
                last = message
    if judged and last is not None and not last.trusted:
        raise _contradicted(source.recording, last.warnings[:1])
    return found


def _contradicted(file: Path, doubts: Sequence[QualityWarning]) -> InputError:
    """Return the error of data that contradict the description or the layout; the gravest first."""
    reason = "; ".join(f"{doubt.code}: {doubt.text}" for doubt in doubts)
    wrong = "layout" if any(doubt.code == "sensor" for doubt in doubts) else "description"
    return InputError(
        f"{file}: its posterior is not trusted ({reason}); correct the {wrong} first (`pilewatch "
        "update` reports the misfit of every mode, --scenario takes what was corrected)"
    )


def _seen(estimate: ModalEstimate, source: Source, water_level: float) -> SeenWindow | None:
    """Return the window as evidence; None where it may not speak of the foundation."""
    usable = usable_estimate(estimate, source.scenario.operation, source.layout)
    if isinstance(usable, WindowRejected):
        return None
    try:
        seen = mode_observations(usable, source.layout.channel_names)
    except EstimateRefused:
        return None
    return SeenWindow.of(estimate, seen, float(np.nan_to_num(estimate.water_level - water_level)))


def _require_one_structure(scenario: Scenario) -> None:
    if scenario.updating.population:
        raise InputError(
            f"scenario {scenario.name} begins with a farm's prior of the springs "
            "([updating] population); calibrate without it"
        )


def _require_alike(first: Source, other: Source) -> None:
    if _sensors(first.layout) != _sensors(other.layout):
        raise InputError(
            f"{other.recording} is of turbine {other.layout.turbine} with channels "
            f"{', '.join(other.layout.channel_names)}; {first.recording} of {first.layout.turbine} "
            f"with {', '.join(first.layout.channel_names)}: calibrate one turbine with one layout"
        )


def _sensors(layout: SensorLayout) -> tuple[object, ...]:
    return (layout.turbine, layout.channels)


# ---- text ----------------------------------------------------------------------------------------


def description_text(scenario: Scenario) -> str:
    """Return the TOML text of a scenario's structure, as it is stored or shipped."""
    name = scenario.turbine.description
    stored = dict(scenario.files).get(name)
    return turbine_text(name) if stored is None else stored


def with_section(text: str, calibration: Calibration) -> str:
    """Return a description's text with the calibration at its end, in place of an earlier one.

    Raises InputError where something else stands behind an earlier one: it would be lost.
    """
    before = text.split(f"\n{SECTION}", 1)[0].rstrip()
    lines = [
        SECTION,
        f"source = {toml_string(calibration.source)}",
        f"springs_sign = {toml_string(calibration.springs_sign)}",
        "names = [" + ", ".join(map(toml_string, calibration.names)) + "]",
        f"stds = {_numbers(calibration.stds)}",
    ]
    for each in calibration.alternatives:
        lines += [
            "",
            "[[calibration.alternatives]]",
            f"name = {toml_string(each.name)}",
            f"weight = {each.weight!r}",
            f"mean = {_numbers(each.mean)}",
            f"covariance = {_numbers(each.covariance)}",
        ]
    written = before + "\n\n" + "\n".join(lines) + "\n"
    described, again = (parse_turbine(each, source="the description") for each in (text, written))
    if replace(described, calibration=None) != replace(again, calibration=None):
        raise InputError(f"the description has sections behind {SECTION}: move that one to its end")
    return written


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in values) + "]"
