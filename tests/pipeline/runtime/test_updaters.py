"""What the updating of a run is made of."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from pipeline.runtime import updaters
from pipeline.runtime.updaters import Turbines
from pipeline.scenario import load_scenario


@pytest.mark.parametrize("kept", [True, False])
def test_earlier_recordings_are_read_where_snapshots_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: bool
) -> None:
    """Estimates that no snapshot has answered may stand in them; without snapshots, none can."""
    made: list[object] = []
    monkeypatch.setattr(updaters, "latest_estimates", lambda files, _: tuple(files))
    monkeypatch.setattr(Turbines, "_made", lambda *_: None)
    monkeypatch.setattr(
        updaters,
        "UpdatingNode",
        lambda *_, past, **__: made.append(past) or SimpleNamespace(begin=lambda _: None),
    )
    scenario, earlier = load_scenario("parked"), (tmp_path / "a.mcap",)
    folder = tmp_path / "kept" if kept else None
    Turbines(scenario, scenario.layout, {}, folder, earlier=earlier).updating()
    assert made == [earlier if kept else ()]


def test_the_first_turbines_updating_is_made_before_a_window_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[str] = []
    monkeypatch.setattr(
        updaters, "UpdatingNode", lambda *_, **__: SimpleNamespace(begin=begun.append)
    )
    scenario = load_scenario("parked")
    Turbines(scenario, scenario.layout, {}, None).updating()
    assert begun == [scenario.layout.turbine]
