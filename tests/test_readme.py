"""The README is run, not only read."""

import re
from contextlib import closing
from pathlib import Path

import pytest

from pipeline.monitoring.alarms.settings import load_notices
from pipeline.monitoring.status import ENDPOINT_FILE, KEY, StatusNode
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub

README = Path(__file__).parents[1] / "README.md"


def code_blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def test_the_library_example_identifies_and_updates(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (example,) = [each for each in code_blocks("python") if "FoundationUpdater" in each]
    monkeypatch.chdir(README.parent)
    exec(compile(example, str(README), "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in printed] == ["k11", "k22", "k12", "sigma"]


def test_the_status_example_prints_the_posteriors_of_the_session_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (example,) = [each for each in code_blocks("python") if "@status" in each]
    endpoint = free_endpoint()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ENDPOINT_FILE).write_text(f"{endpoint}\n")
    monkeypatch.chdir(tmp_path)
    with closing(ZenohBus(hub(endpoint))) as bus:
        bus.answer(f"{KEY}/t1", StatusNode("live").answer)
        exec(compile(example, str(README), "exec"), {})

    assert capsys.readouterr().out == "[]\n"


def test_the_notices_example_is_a_file_that_is_understood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAIL_PASSWORD", "secret")
    path = tmp_path / "notices.toml"
    (example,) = [each for each in code_blocks("toml") if "[[webhook]]" in each]
    path.write_text(example)

    settings = load_notices(path)

    assert (len(settings.webhook), len(settings.mqtt), len(settings.mail)) == (1, 1, 1)


def test_two_commands_do_all_the_setting_up() -> None:
    run, test = (block.strip() for block in code_blocks("sh"))
    assert run.endswith("pilewatch run")
    assert "pytest" in test
    assert "\n" not in run + test


def test_every_picture_of_the_readme_exists() -> None:
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", README.read_text(encoding="utf-8"))
    assert pictures
    assert all((README.parent / picture).is_file() for picture in pictures)
