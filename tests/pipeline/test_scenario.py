"""One TOML file is the whole experiment."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.app import Outputs, build
from pipeline.oma.settings import OmaSettingsError
from pipeline.scenario import (
    ScenarioError,
    load_scenario,
    modes_only,
    scenario_from_metadata,
    scenario_from_text,
    scenario_metadata,
    shipped_scenarios,
    with_overrides,
)
from sensors.structure.description import load_turbine, shipped_text


def test_every_shipped_scenario_can_be_read() -> None:
    assert "parked" in shipped_scenarios()
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.title
        assert scenario.layout.channels


def test_the_parked_scenario_has_four_biaxial_sensors_fore_aft_first() -> None:
    layout = load_scenario("parked").layout
    assert layout.channel_names == tuple(
        f"z{elevation}-{axis}" for axis in ("fa", "ss") for elevation in (41, 80, 106, 145)
    )
    assert {channel.coupling for channel in layout.channels} == {"dc"}


def test_a_scenario_comes_back_from_a_recordings_metadata() -> None:
    scenario = with_overrides(load_scenario("parked"), duration=30.0, seed=7)
    again = scenario_from_metadata(scenario_metadata(scenario), "recording")
    assert again.simulation == scenario.simulation
    assert again.seed == 7
    assert (again.name, again.oma, again.updating) == ("parked", scenario.oma, scenario.updating)


def test_what_is_not_overridden_stays_as_the_scenario_has_it() -> None:
    parked = load_scenario("parked")
    shorter, other = with_overrides(parked, duration=30.0), with_overrides(parked, seed=7)
    assert (shorter.simulation.duration, shorter.seed) == (30.0, parked.seed)
    assert shorter.simulation == replace(parked.simulation, duration=30.0)
    assert (other.simulation, other.seed) == (parked.simulation, 7)


def test_the_sign_of_k12_is_the_scenarios_where_it_says_one() -> None:
    text = '[turbine]\nsprings_sign = "embedded-pile"\n'
    assert scenario_from_text(text, "pile.toml").structure.foundation.sign == "embedded-pile"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[oma\n", "not valid TOML"),
        ("colour = 1\n", "unknown key 'colour'"),
        ("text = 'x'\n", "unknown key 'text'"),
        ("[turbine]\nid = 'a/b'\n", r"\[turbine\]: id is 'a/b'"),
        ("[sensors]\nunit = 'to/wer'\n", r"\[sensors\]: unit is 'to/wer': it cannot be part"),
        ("[sensors]\nelevations = []\n", r"\[sensors\]: elevations is \[\]; .* at least one"),
        (
            "[farm]\nmembers = [{ unit = 'a b' }]\n",
            r"\[farm.*\]: unit is 'a b': a name without spaces",
        ),
        (
            "[simulation]\nunits = [{ name = 'a', elevations = [] }]\n",
            r"unit a: elevations is \[\]",
        ),
        (
            "[simulation]\nunits = [{ name = 'a', elevations = [41.0] },"
            " { name = 'a', elevations = [80.0] }]\n",
            r"\[simulation\]: units has 2 called 'a'; each has a name of its own",
        ),
        ("[oma]\nhop = 900\n", r"\[oma\].*hop is 900 s, longer than window_duration"),
        ("[simulation]\nduration = -1\n", r"\[simulation\]: duration is -1; it must be positive"),
        ("[updating.sampler]\nwalkers = 3\n", r"\[updating.sampler\]: walkers is 3"),
    ],
)
def test_a_mistake_is_named_with_its_section(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as error:
        scenario_from_text(text, "mine.toml")
    assert str(error.value).startswith("mine.toml")
    assert "\n" not in str(error.value)


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(str(tmp_path))


def test_an_ac_coupled_layout_has_the_scenarios_corner_frequency() -> None:
    scenario = scenario_from_text('[sensors]\ncoupling = "ac"\ncorner_frequency = 0.2\n', "a.toml")
    assert {each.corner_frequency for each in scenario.layout.channels} == {0.2}


def test_a_stored_scenario_may_have_keys_of_an_earlier_version() -> None:
    text = "[flow]\nunacknowledged_blocks = 7\n[simulation.sea]\npeak_enhancement = 2.0\n"
    metadata = scenario_metadata(load_scenario("parked")) | {"toml": text}
    assert scenario_from_metadata(metadata, "recording").name == "parked"
    with pytest.raises(ScenarioError, match="unknown key 'flow'"):
        scenario_from_text(text, "own.toml")


def test_keys_that_are_constants_now_are_ignored_in_a_recording_and_refused_in_a_file(
    caplog: pytest.LogCaptureFixture,
) -> None:
    text = (
        "[oma]\nmaximum_damping = 0.2\nhop = 300.0\n"
        "[updating.pairing]\ntolerances = [0.02, 0.01]\n"
        "[[simulation.faults]]\nkind = 'stuck'\nchannel = 'x'\nstart = 1.0\nduration = 9.0\n"
    )
    metadata = scenario_metadata(load_scenario("parked")) | {"toml": text}
    for _ in range(2):
        loaded = scenario_from_metadata(metadata, "scenario in old.mcap")
    assert loaded.oma.hop == 300.0
    assert loaded.oma.maximum_damping == 0.1
    (note,) = [each.message for each in caplog.records]
    assert note == (
        "scenario in old.mcap: ignored, now constants: oma.maximum_damping, "
        "updating.pairing.tolerances"
    )
    with pytest.raises(ScenarioError, match=r"own.toml \[oma\]: 'maximum_damping' is no key") as no:
        scenario_from_text(text, "own.toml")
    assert "always 0.1" in str(no.value)


@pytest.mark.parametrize("name", ['a"b', "back\\slash", "line\nbreak", "ζ\U000e0001"])
def test_a_turbine_of_any_name_makes_a_scenario(name: str) -> None:
    assert modes_only(name).turbine.id == name


def test_a_reference_channel_that_no_sensor_is_ends_a_run_before_it_begins() -> None:
    scenario = scenario_from_text('[oma]\nreference_channels = ["z999-fa"]', "own.toml")
    with pytest.raises(OmaSettingsError, match="z999-fa"):
        build(scenario, scenario.layout, Outputs())


def _own_tower(folder: Path, k11: str) -> None:
    folder.mkdir()
    text = shipped_text("iea15mw_monopile").replace("k11 = 0.098e11", f"k11 = {k11}")
    (folder / "tower.toml").write_text(text, encoding="utf-8")


def test_a_file_that_a_scenario_names_is_the_one_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    _own_tower(tmp_path / "mine", "0.1e11")
    _own_tower(tmp_path / "other", "0.2e11")
    text = (
        '[turbine]\nid = "t1"\ndescription = "tower.toml"\n[simulation]\nstructure = "tower.toml"\n'
    )
    (tmp_path / "mine" / "scenario.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)  # where there is none
    scenario = load_scenario("mine/scenario.toml")
    assert scenario.structure.foundation.k11 == 0.1e11
    stored = scenario_from_metadata(scenario_metadata(scenario), "recording")
    assert stored.structure.foundation.k11 == 0.1e11
    assert load_turbine(scenario.simulation.structure).foundation.k11 == 0.1e11
    assert not caplog.messages
    monkeypatch.chdir(tmp_path / "other")  # where there is that of another tower
    assert load_scenario("../mine/scenario.toml").structure.foundation.k11 == 0.1e11
    assert any("beside the scenario" in message for message in caplog.messages)


def test_a_file_that_is_not_beside_the_scenario_is_that_of_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _own_tower(tmp_path / "towers", "0.1e11")
    (tmp_path / "scenarios").mkdir()
    text = '[turbine]\ndescription = "towers/tower.toml"\n'
    (tmp_path / "scenarios" / "mine.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_scenario("scenarios/mine.toml").structure.foundation.k11 == 0.1e11
