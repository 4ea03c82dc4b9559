"""The README is run, not only read."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


def code_blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def test_the_library_example_identifies_and_updates(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (example,) = code_blocks("python")
    monkeypatch.chdir(README.parent)
    exec(compile(example, str(README), "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in printed] == ["k11", "k22", "k12", "sigma"]


def test_two_commands_do_all_the_setting_up() -> None:
    run, test = (block.strip() for block in code_blocks("sh"))
    assert run.endswith("pilewatch run")
    assert "pytest" in test
    assert "\n" not in run + test


def test_every_picture_of_the_readme_exists() -> None:
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", README.read_text(encoding="utf-8"))
    assert pictures
    assert all((README.parent / picture).is_file() for picture in pictures)
