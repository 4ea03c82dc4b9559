"""README and documentation are run, not only read."""

import os
import re
import subprocess
import sys
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import pytest

from pipeline.monitoring.alarms.settings import load_notices
from pipeline.monitoring.status import ENDPOINT_FILE, STATUS_KEY, StatusNode
from pipeline.sources.sources import open_source
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from tests.pipeline.report.example_session import recorded, session

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = ROOT / "docs" / "pages"


# Windows of the recording that another test has identified are taken from it, to the bit.
pytestmark = pytest.mark.usefixtures("identified_once")


def code_blocks(language: str, page: Path = README) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_the_example_of_the_library_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pilewatch", reason="the project is not installed")
    monkeypatch.chdir(README.parent)
    (example,) = code_blocks("python")
    exec(compile(example, str(README), "exec"), {})
    assert capsys.readouterr().out.startswith("<Modes:")


@pytest.mark.nightly
def test_the_example_that_updates_from_a_recording_runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an hour; one of two minutes does the same in the tests of the library."""
    pytest.importorskip("pilewatch", reason="the project is not installed")
    monkeypatch.chdir(README.parent)
    example, *_ = code_blocks("python", PAGES / "library.md")
    exec(compile(example, "page", "exec"), {})
    assert capsys.readouterr().out.startswith("<Posterior:")


def test_the_examples_that_read_a_session_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pilewatch", reason="the project is not installed")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    (tmp_path / "out").mkdir()
    recorded(tmp_path / "out" / "session.mcap", session())
    monkeypatch.chdir(tmp_path)
    *_, plots_example, tables_example = code_blocks("python", PAGES / "library.md")
    (design_example,) = code_blocks("python", PAGES / "your-turbine.md")
    for example in (plots_example, design_example):
        exec(compile(example, "page", "exec"), {})
    if all(find_spec(package) for package in ("pandas", "xarray", "arviz")):
        exec(compile(plots_example + tables_example, "page", "exec"), {})
    pyplot.close("all")
    assert "of 400 draws count" in capsys.readouterr().out


def test_the_status_example_prints_the_posteriors_of_the_session_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (example,) = [
        each for each in code_blocks("python", PAGES / "operating.md") if "@status" in each
    ]
    endpoint = free_endpoint()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ENDPOINT_FILE).write_text(f"{endpoint}\n")
    monkeypatch.chdir(tmp_path)
    with closing(ZenohBus(hub(endpoint))) as bus:
        bus.answer(f"{STATUS_KEY}/t1", StatusNode("live").answer)
        exec(compile(example, str(README), "exec"), {})

    assert capsys.readouterr().out == "[]\n"


def test_the_notices_example_is_a_file_that_is_understood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAIL_PASSWORD", "secret")
    path = tmp_path / "notices.toml"
    (example,) = [
        each for each in code_blocks("toml", PAGES / "operating.md") if "[[webhook]]" in each
    ]
    path.write_text(example)

    settings = load_notices(path)

    assert (len(settings.webhook), len(settings.mqtt), len(settings.mail)) == (1, 1, 1)


def test_the_files_of_the_tower_page_are_understood(tmp_path: Path) -> None:
    blocks = code_blocks("toml", PAGES / "tower.md")
    layout, scenario, notices = (tmp_path / name for name in ("low.toml", "my.toml", "n.toml"))
    for path, text in zip((layout, scenario, notices), blocks, strict=True):
        path.write_text(text)

    live = open_source("live", str(scenario), (layout,))
    assert live.layout.turbine == live.scenario.turbine.id == "t1"
    assert load_notices(notices).notices.k22_below == 0.95


def test_two_commands_do_all_the_setting_up() -> None:
    run, test = (block.strip() for block in code_blocks("sh"))
    assert run.endswith("pilewatch run")
    assert "pytest" in test
    assert "\n" not in run + test


def test_the_first_line_of_the_readme_that_names_pytest_is_the_test_command() -> None:
    # whoever checks the project takes that line for the command
    _, test = (block.strip() for block in code_blocks("sh"))
    named = [line for line in README.read_text(encoding="utf-8").splitlines() if "pytest" in line]
    assert named[0] == test


@pytest.mark.parametrize("page", [README, *sorted(PAGES.glob("*.md"))], ids=lambda p: p.name)
def test_every_picture_and_page_that_is_named_exists(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]
    notebooks = (ROOT / "docs" / "notebooks").glob("*.ipynb")
    names = ("commands", "scenario", "description", "layout", "notices", "mapping", "export")
    generated = {f"reference/{name}.md" for name in names}
    generated |= {f"notebooks/{path.stem}.md" for path in notebooks}
    assert [x for x in local if not (page.parent / x).is_file() and x not in generated] == []


def test_the_readme_is_one_page() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.nightly  # the examples, links and generated pages have tests of their own
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs_gen_files", reason="the extra `docs` is not installed")
    pytest.importorskip("mkdocstrings", reason="the extra `docs` is not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    built = subprocess.run(
        [*command, "--config-file", str(ROOT / "docs" / "mkdocs.yml"), "--site-dir", str(tmp_path)],
        env=os.environ
        | {
            "DOCS_NOTEBOOKS": "code",
            "NO_MKDOCS_2_WARNING": "1",
            "DISABLE_MKDOCS_2_WARNING": "true",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    assert "sampling_rate" in (tmp_path / "reference" / "library" / "index.html").read_text()
    assert "window_duration" in (tmp_path / "reference" / "scenario" / "index.html").read_text()
