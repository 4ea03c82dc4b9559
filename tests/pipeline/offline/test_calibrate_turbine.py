"""`calibrate` on recorded sessions: a description that later sessions begin with."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import FoundationEvent, Message, QualityWarning
from pipeline.offline.calibrate_turbine import calibrate_turbine, with_section
from pipeline.recording.writer import whole_recording
from pipeline.scenario import scenario_from_text, scenario_metadata
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from sensors.structure.calibration import AlternativeFigures, Calibration
from sensors.structure.description import parse_turbine, shipped_text
from tests.benchmarks.first_weeks import LAYOUT, drawn
from tests.pipeline.report.example_session import posterior

SECTION = Calibration(
    "published", ("steel_modulus", "rna_mass"), (0.01, 0.02),
    (AlternativeFigures("converged blades", 1.0, (0.4, -0.1), (0.5, -0.25, 0.75)),), 'two "weeks"',
)  # fmt: skip
BENDING = '[structure.uncertain]\nflooding = "exact"\ntube_shear = "exact"\n'
"""With the blades' alternatives only: a fit takes a third of the time."""
EXACT = '[structure]\nuncertain = "exact"\n'


@pytest.fixture(scope="module")
def estimates():
    return drawn(62002, "published", 24)[1]


def session(path: Path, messages: list[Message], scenario: str = "") -> Path:
    """A session of a few estimates with a second of samples."""
    chosen = scenario_from_text(scenario, "tower.toml")
    samples = np.random.default_rng(0).standard_normal((20, len(LAYOUT.channels)))
    block = AccelerationBlock(
        LAYOUT.turbine, LAYOUT.unit, "s", LAYOUT.layout_id, 0, 0, 0, 20.0,
        samples.astype(np.float32),
    )  # fmt: skip
    with whole_recording(path, metadata={"scenario": scenario_metadata(chosen)}) as recorder:
        for message in (LAYOUT, block, *messages):
            recorder.handle(message)
    return path


def test_a_description_with_a_calibration_reads_as_it_was_written() -> None:
    text = with_section(shipped_text("iea15mw_monopile"), SECTION)
    assert parse_turbine(text, source="x.toml").calibration == SECTION
    again = with_section(text, replace(SECTION, source="three weeks"))
    assert again.count("[calibration]") == 1
    assert parse_turbine(again, source="x.toml").calibration.source == "three weeks"


def test_what_stands_behind_an_earlier_calibration_is_not_lost() -> None:
    plain = shipped_text("iea15mw_monopile")
    water = plain[plain.index("[water]") :].split("\n[", 1)[0]
    moved = with_section(plain.replace(water, ""), SECTION) + "\n" + water
    with pytest.raises(InputError, match="move that one to its end"):
        with_section(moved, SECTION)


def test_sessions_in_any_order_and_twice_give_one_calibration(estimates, tmp_path: Path) -> None:
    first = session(tmp_path / "a.mcap", estimates[:14], BENDING)
    second = session(tmp_path / "b.mcap", estimates[10:], BENDING)
    found = calibrate_turbine([second, first])
    assert found.n_windows == len(estimates)
    assert found.level_known
    assert len(found.levels) > 2
    groups = rf" {len(estimates)} windows, \d+ of them in {len(found.levels)} groups by water level"
    assert re.search(groups, found.calibration.source)
    figures = found.as_json()
    assert 0.5 < figures["springs_over_nominal"]["k11"]["median"] < 2.0
    described = tmp_path / "calibrated.toml"
    described.write_text(found.text, "utf-8")
    later = session(tmp_path / "c.mcap", [], f'[turbine]\ndescription = "{described}"\n')
    described.unlink()  # the recording holds its text
    stored = replayed(later).scenario.structure.calibration
    assert stored == parse_turbine(found.text, source="x.toml").calibration
    assert stored is not None
    np.testing.assert_allclose(stored.alternatives[0].mean, found.best.mean, rtol=1e-8)


def test_what_cannot_be_calibrated_is_refused_in_one_line(estimates, tmp_path: Path) -> None:
    event = FoundationEvent("iea15mw", 3, 1, "foundation", 0.99, 1, 1, 1, (), (), "it changed")
    refused = {
        "taken as exact": session(tmp_path / "exact.mcap", estimates, EXACT),
        "has no modal estimates": session(tmp_path / "none.mcap", []),
        "3 windows can be used": session(tmp_path / "few.mcap", estimates[:3]),
        "half.mcap: 3 windows can be used, 3 cannot": session(
            tmp_path / "half.mcap",
            [*estimates[:3], *(replace(each, modes=()) for each in estimates[3:6])],
        ),
        f"3 of {len(estimates)} windows have a water level": session(
            tmp_path / "level.mcap",
            [*estimates[:3], *(replace(each, water_level=np.nan) for each in estimates[3:])],
        ),
        "its structure changed in window 3": session(tmp_path / "e.mcap", [*estimates, event]),
    }
    for words, path in refused.items():
        with pytest.raises(InputError, match=words) as error:
            calibrate_turbine([path])
        assert "\n" not in str(error.value)


def test_what_the_files_state_is_refused_before_anything_is_fitted(
    estimates, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    turbine = LAYOUT.turbine
    heavy = QualityWarning("figure-outside-prior", "rna_mass lies 10.1 standard deviations below")
    displaced = QualityWarning("sensor", "z80 sits higher")
    untrusted = [
        posterior(3, turbine=turbine, trusted=False, warnings=(doubt,))
        for doubt in (heavy, displaced)
    ]
    event = FoundationEvent(turbine, 3, 1, "foundation", 0.99, 1, 1, 1, (), (), "it changed")
    refused = {
        r"not trusted \(figure-outside-prior: rna_mass.*correct the description": [untrusted[0]],
        r"not trusted \(sensor: z80 sits higher\); correct the layout": [untrusted[1]],
        "its structure changed": [event],
    }
    monkeypatch.setattr("pipeline.offline.calibrate_turbine.joint_inference", _not_reached)
    for number, (words, messages) in enumerate(refused.items()):
        path = session(tmp_path / f"{number}.mcap", [*estimates, *messages])
        with pytest.raises(InputError, match=words):
            calibrate_turbine([path])
    few = session(tmp_path / "few.mcap", estimates[:3])
    with pytest.raises(InputError, match="3 windows can be used"):
        calibrate_turbine([few])


def test_an_earlier_verdict_is_not_that_of_the_last_window_or_of_another_scenario(
    estimates, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    doubt = QualityWarning("description-off", "modes find their partners only within 3.0%")
    wrong = posterior(3, turbine=LAYOUT.turbine, trusted=False, warnings=(doubt,))
    right = posterior(4, turbine=LAYOUT.turbine)
    monkeypatch.setattr("pipeline.offline.calibrate_turbine.joint_inference", _not_reached)
    later = session(tmp_path / "later.mcap", [*estimates, wrong, right])
    with pytest.raises(AssertionError, match="fitted"):
        calibrate_turbine([later])
    corrected = tmp_path / "corrected.toml"
    corrected.write_text("")
    untrusted = session(tmp_path / "untrusted.mcap", [*estimates, wrong])
    with pytest.raises(AssertionError, match="fitted"):
        calibrate_turbine([untrusted], scenario=str(corrected))


def _not_reached(*_: object, **__: object) -> None:
    raise AssertionError("it is fitted")


@pytest.mark.nightly
def test_figures_far_from_the_description_are_no_calibration(estimates, tmp_path: Path) -> None:
    text = shipped_text("iea15mw_monopile")
    heavier = tmp_path / "tower.toml"
    heavier.write_text(text.replace("mass = 530887.918", "mass = 620000.0"), "utf-8")
    described = f'{BENDING}[turbine]\ndescription = "{heavier}"\n'
    path = session(tmp_path / "a.mcap", estimates, described)
    with pytest.raises(InputError, match="description first"):
        calibrate_turbine([path])
