"""Recordings that store other settings than the newest are named, wherever they are processed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.archive.survey import FileSurvey, Part
from pipeline.archive.turbines import archived_turbines
from pipeline.recording.info import RecordingInfo
from pipeline.recording.writer import Recorder
from pipeline.scenario import (
    Scenario,
    scenario_from_text,
    scenario_metadata,
)
from pipeline.scenario.differences import (
    SettingsDifference,
    other_settings,
    settings_differences,
)
from pipeline.sources.folder_differences import report_other_layouts, report_shared_times
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.structure.description import shipped_text
from tests.pipeline.archive.test_plan import START_NS, part

LAYOUT = biaxial_layout("l", turbine="t", unit="tower", elevations=(41.0, 80.0))
RAISED = biaxial_layout("l", turbine="t", unit="tower", elevations=(30.0, 80.0))
NO_STRUCTURE = '[turbine]\nid = "t"\ndescription = "none"\n'


def scenario(text: str) -> Scenario:
    return scenario_from_text(text, "s.toml")


def differences(before: str, after: str) -> list[tuple[str, str, str]]:
    found = settings_differences(scenario(before), scenario(after), "t")
    return [(each.name, each.before, each.after) for each in found]


def test_settings_that_results_depend_on_are_compared_with_their_defaults() -> None:
    assert differences('title = "a"\nseed = 1', 'title = "b"\nseed = 2') == []
    assert differences("[simulation]\nduration = 900.0", "") == []
    assert differences('[turbine]\ndescription = "none"', "") == [
        ("[turbine] description", "'none'", "'iea15mw_monopile'")
    ]
    assert differences("", '[turbine]\nsprings_sign = "published"') == [
        ("[turbine] springs_sign", "not set", "'published'")
    ]
    assert differences("[oma]\nwindow_duration = 300.0\nhop = 300.0", "[oma]\nhop = 300.0") == [
        ("[oma] window_duration", "300.0", "600.0")
    ]
    (structure,) = differences("", "[structure.uncertain]\nsteel_modulus = 0.05")
    assert structure[0] == "[structure] stds"


def test_members_of_a_farm_are_compared_one_by_one() -> None:
    farm = "[[farm.members]]\nid = 't'\n[[farm.members]]\nid = 'u'\n"
    other = farm.replace("id = 'u'", "id = 'u'\nsprings_sign = 'published'")
    assert differences(farm, other) == []
    (found,) = settings_differences(scenario(farm), scenario(other), "u")
    assert found == SettingsDifference("[turbine] springs_sign", "not set", "'published'")


def test_of_a_description_the_first_line_that_differs_is_named_comments_aside() -> None:
    text = shipped_text("iea15mw_monopile")
    own = replace(scenario('[turbine]\ndescription = "own.toml"'), files=(("own.toml", text),))
    commented = replace(own, files=(("own.toml", text + "\n# a comment\n"),))
    thicker = text.replace("thickness = 0.0", "thickness = 0.1", 1)
    changed = replace(own, files=(("own.toml", thicker),))

    assert settings_differences(own, commented, "t") == ()
    (found,) = settings_differences(own, changed, "t")
    number = int(found.name.removeprefix("line ").removesuffix(" of own.toml"))
    assert text.splitlines()[number - 1] != thicker.splitlines()[number - 1]
    assert "thickness = 0.1" in found.after


def survey(each: Part, text: str) -> FileSurvey:
    stored = scenario_metadata(scenario(text)) if text else {}
    return FileSurvey(each.path, each.fingerprint, (each,), (), tuple(sorted(stored.items())))


def test_an_archive_names_what_older_recordings_have_stored_otherwise() -> None:
    shorter = NO_STRUCTURE + "[oma]\nwindow_duration = 300.0\nhop = 300.0\n"
    parts = [part(name, 0, 250, session=name, start=1e5 * n) for n, name in enumerate("abcd")]
    surveys = [
        survey(each, text)
        for each, text in zip(
            parts, (shorter, shorter, "", 'title = "new"\n' + NO_STRUCTURE), strict=True
        )
    ]

    (turbine,) = archived_turbines(surveys, None, None)
    (chosen,) = archived_turbines(surveys, "modes-only", None)

    processed = "; all recordings are processed with the settings of the newest, unless --scenario"
    assert turbine.scenario.title == "new"
    assert turbine.warnings == (
        f"[oma] window_duration is 300.0 in b, 600.0 in d{processed} names others",
        f"[oma] hop is 300.0 in b, 600.0 in d{processed} names others",
    )
    assert chosen.warnings == ()


def test_a_recording_whose_stored_scenario_is_none_of_this_version_is_passed_over() -> None:
    old, new = (part(name, 0, 250, session=name, start=1e5 * n) for n, name in enumerate("ab"))
    unknown = replace(survey(old, ""), scenario=(("toml", "[never]\nwas = 1\n"),))
    (turbine,) = archived_turbines([unknown, survey(new, NO_STRUCTURE)], None, None)
    assert turbine.warnings == ()


def info(name: str, layout: SensorLayout, text: str = "") -> RecordingInfo:
    metadata = {"scenario": scenario_metadata(scenario(text))} if text else {}
    return RecordingInfo(Path(name), 0, metadata, (), (), (layout,), ())


def test_a_folder_that_is_replayed_has_a_line_where_its_layouts_differ(
    caplog: pytest.LogCaptureFixture,
) -> None:
    report_other_layouts([info("a", LAYOUT), info("b", LAYOUT), info("c", RAISED)])
    (line,) = caplog.messages
    assert line == (
        "t: channel z41-fa is there in b, is not in c; all windows are read at the layout of the "
        "newest file (`pilewatch reprocess` reads each at its own)"
    )
    caplog.clear()
    report_other_layouts([info("a", LAYOUT), info("c", LAYOUT)])
    other = replace(RAISED, unit="other")
    report_other_layouts([info("a", LAYOUT), info("c", other)])
    assert caplog.messages == []


def test_of_a_folder_that_is_replayed_each_setting_is_a_line() -> None:
    older = NO_STRUCTURE + "[oma]\nhop = 300.0\n"
    texts = {"d": NO_STRUCTURE, "c": "", "b": older, "a": older}
    stored = {
        name: scenario_metadata(scenario(text)) if text else {} for name, text in texts.items()
    }
    assert list(other_settings(stored.items(), scenario(NO_STRUCTURE), "t")) == [
        "[oma] hop is 300.0 in b, 600.0 in d; all recordings are processed with the settings of "
        "the newest, unless --scenario names others"
    ]
    same = {name: stored[name] for name in "ba"}
    assert list(other_settings(same.items(), scenario(older), "t")) == []


def test_of_a_folder_that_is_replayed_each_shared_time_is_a_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    parts = [part("a", 0, 250), part("b", 0, 250, session="again", start=15.0)]
    infos = [RecordingInfo(each.path, 0, {}, (), (each,), (), ()) for each in parts]
    report_shared_times(infos)
    assert caplog.messages == [
        "t: a and b both cover 2023-11-14 22:13:35 to 22:13:45 UTC (10 s); both are used "
        "(`pilewatch reprocess` uses them once)"
    ]


def test_a_replayed_folder_reports_all_that_its_files_do_not_have_in_common(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The second begins within the first, at other heights and with another description."""
    for name, second, layout, text in (
        ("a.mcap", 0, LAYOUT, '[turbine]\nid = "t"'),
        ("b.mcap", 5, RAISED, NO_STRUCTURE),
    ):
        metadata = {"scenario": scenario_metadata(scenario(text))}
        recorder = Recorder(tmp_path / name, metadata=metadata, clock=None)
        recorder.handle(layout)
        for number in range(10):
            recorder.handle(
                AccelerationBlock(
                    turbine="t",
                    unit="tower",
                    session=name,
                    sequence=number,
                    first_sample=10 * number,
                    start_ns=START_NS + (second + number) * NANOSECONDS,
                    sampling_rate=10.0,
                    layout_id=layout.layout_id,
                    samples=np.zeros((10, 4), dtype=np.float32),
                )
            )
        recorder.close()

    replayed(tmp_path)

    layout_line, time_line, settings_line = caplog.messages
    assert layout_line.startswith(f"t: channel z41-fa is there in {tmp_path / 'a.mcap'}, is not in")
    assert "both cover 2023-11-14 22:13:25 to 22:13:30 UTC (5 s); both are used" in time_line
    assert settings_line.startswith("t: [turbine] description is 'iea15mw_monopile' in")
