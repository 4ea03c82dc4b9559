"""The page: everything of the session is on it, it stands alone, it is small."""

import json
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.messages import (
    FoundationTruth,
    ModalEstimate,
    RefusedMode,
    StabilisationDiagram,
    StreamGap,
)
from pipeline.recording.errors import RecordingError
from pipeline.report.canvas import PageFigure
from pipeline.report.figures_json import session_json
from pipeline.report.page import _key_figures, _provenance, page, write_page
from pipeline.report.recorded_session import RecordedSession, TurbineRecord, read_session
from pipeline.report.sentences import measurement_sentences
from pipeline.report.wording import between_instants
from pipeline.updating.prior import PriorSettings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.errors import InputError
from tests.pipeline.example_messages import LAYOUT, START_NS, block
from tests.pipeline.report.example_session import estimate, posterior, recorded, session
from tests.pipeline.report.test_html import assert_stands_alone

PAGE = Path(__file__).parents[2] / "golden" / "page.txt"
LARGEST = 3e6  # [bytes]


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _recorded(tmp_path_factory.mktemp("report") / "session.mcap")


def _recorded(path: Path) -> Path:
    return recorded(path, session(), pilewatch={"version": "0.1.0"}, scenario={"toml": "a = 1\nb"})


@pytest.fixture(scope="module")
def one_page(one: Path) -> str:
    return page(read_session(one))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and of their SVG only the words: it takes most of a page's time."""
    monkeypatch.setattr(PageFigure, "svg", words_in)


def words_in(made: PageFigure) -> str:
    """Titles, labels and legends of a figure, not its ticks."""
    texts = [each.get_text() for each in made.figure.findobj(lambda a: hasattr(a, "get_text"))]
    return f"<svg>{' '.join(texts)}</svg>"


def headings(text: str) -> list[str]:
    """What the sections are called."""
    return re.findall(r"<h[23][^>]*>(.*?)</h[23]>", text)


def test_a_page_stands_alone_and_is_small(one_page: str) -> None:
    assert_stands_alone(one_page)
    assert len(one_page.encode()) < LARGEST / 2  # so that a farm's, of two of these, is small too
    assert_links_lead_somewhere(one_page)


def assert_links_lead_somewhere(text: str) -> None:
    for target in re.findall(r'href="#([\w-]+)"', text):
        assert f'id="{target}"' in text


def words_of(text: str) -> list[str]:
    """What a page says, line by line, without its pictures."""
    text = re.sub(r"<(svg|style|script)\b.*?</\1>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"</(p|h\d|tr|li|dd|dt|summary|figcaption|title|pre)>", "\n", text)
    text = unescape(re.sub(r"<[^>]+>", " ", text))
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def test_a_page_says_what_it_said(one: Path, one_page: str) -> None:
    """A change that is meant renews the text: `python -m tests.pipeline.report.test_page`."""
    assert _said(one, one_page) == PAGE.read_text("utf-8")


def _said(one: Path, text: str) -> str:
    return "\n".join(words_of(text)).replace(str(one), "session.mcap") + "\n"


def test_sentences_come_before_figures_and_figures_before_settings(one_page: str) -> None:
    assert headings(one_page) == [
        *("Foundation", "Changes", "Modes", "Identification", "Data quality", "Settings"),
        "scenario.toml",
    ]
    order = ("k22 fell by", "<dl", "Springs of the foundation", "<svg", "a = 1")
    places = [one_page.index(each) for each in order]
    assert places == sorted(places)


@pytest.mark.usefixtures("undrawn")
def test_what_was_refused_has_its_reason(one: Path, tmp_path: Path) -> None:
    last = max(
        (each for each in session() if isinstance(each, ModalEstimate)), key=lambda e: e.end_ns
    )
    refused = RefusedMode(3.3079, 0.0144, "scattered", "scattered by 0.3 %")
    poles = np.array([1.1, 3.3], dtype=np.float32)
    diagram = StabilisationDiagram(
        *(last.turbine, last.window, last.start_ns, last.end_ns),
        **dict.fromkeys(
            ("orders", "bands", "frequencies", "frequency_stds", "damping_ratios"), poles
        ),
        refused=(refused,),
    )
    text = page(read_session(recorded(tmp_path / "session.mcap", [*session(), diagram])))
    assert "crosses: refused" in text
    assert "3.3079" in text
    assert "scattered by 0.3 %" in text


@pytest.mark.usefixtures("undrawn")
def test_settings_of_a_simulation_are_not_those_of_a_measurement(tmp_path: Path) -> None:
    measured = [each for each in session() if not isinstance(each, FoundationTruth)]
    settings = {"seed": "1", "duration": "3600.0", "name": "mine"}
    text = page(read_session(recorded(tmp_path / "session.mcap", measured, scenario=settings)))
    assert "name of the scenario" in text
    assert "duration of the simulation" not in text


def test_every_kind_of_result_has_its_picture_or_table(one_page: str) -> None:
    for words in (
        "Stiffness over its nominal value",
        "The last posterior: pairs of springs",
        "on the stiffness, 90 % intervals",
        "All identified modes of all windows",
        "Rejected windows",
        "Predictive check",
        "AutoMAC",
        "Gaps in the stream",
        "recorder",
        "0.998",
    ):
        assert words in one_page
    assert one_page.count("<svg") == 8


@pytest.mark.usefixtures("undrawn")
def test_each_turbine_of_a_farm_has_a_section_and_a_line_that_leads_to_it(tmp_path: Path) -> None:
    both = [*session("north"), *session("south")]
    text = page(read_session(recorded(tmp_path / "farm.mcap", both)))
    assert_stands_alone(text)
    assert headings(text)[0] == "All turbines"
    assert [each for each in headings(text) if each in ("north", "south")] == ["north", "south"]
    assert_links_lead_somewhere(text)


def test_the_parts_of_a_session_are_read_as_one(tmp_path: Path) -> None:
    messages = session()
    recorded(tmp_path / "session.mcap", messages[:9])
    recorded(tmp_path / "session.part2.mcap", [messages[0], *messages[9:]])
    read = read_session(tmp_path)
    assert len(read.files) == 2
    assert len(read.turbines[0].state.posteriors) == 6


def test_the_figures_for_machines_are_those_of_the_page(one: Path) -> None:
    text_found = session_json(read_session(one))
    assert json.loads(json.dumps(text_found, allow_nan=False)) == text_found
    (turbine,) = text_found["turbines"]
    assert turbine["condition"] == "doubt"
    assert turbine["findings"][0].startswith("k22 fell by 9.0 %")
    over_time = turbine["stiffness_over_time"]
    assert [each["window"] for each in over_time] == list(range(6))
    assert {"k11", "k22", "k12"} <= set(over_time[0])
    assert all(len(each["time_ns"]) == 6 for each in turbine["frequency_tracks"])


def test_measurements_without_results_say_what_makes_them(tmp_path: Path) -> None:
    path = recorded(tmp_path / "raw.mcap", [LAYOUT, block(0)])
    with pytest.raises(RecordingError, match=r"no results; `pilewatch run --source replay:"):
        read_session(path)


def test_a_page_that_cannot_be_written_is_one_line(
    one: Path, one_page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.report.page.page", lambda _: one_page)
    with pytest.raises(InputError, match=r"cannot write the report .*none/report\.html: No such"):
        write_page(read_session(one), tmp_path / "none" / "report.html")


def test_the_command_writes_the_page_and_prints_the_figures(
    one: Path, one_page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.report.page.page", lambda _: one_page)
    out = tmp_path / "report.html"
    ran = CliRunner().invoke(app, ["report", str(one), "-o", str(out), "--json"])
    assert ran.exit_code == 0
    assert out.read_text("utf-8") == one_page
    assert json.loads(ran.stdout)["turbines"][0]["turbine"] == "t1"


def modes_only(tmp_path: Path, *, start_ns: int) -> RecordedSession:
    """One identified window of a session without a structural model."""
    first = estimate(0)
    window = replace(first, start_ns=start_ns, end_ns=start_ns + 500 * NANOSECONDS)
    path = recorded(tmp_path / "modes.mcap", [LAYOUT, window])
    (record,) = read_session(path).turbines
    return replace(read_session(path), turbines=(replace(record, has_structure=False),))


@pytest.mark.usefixtures("undrawn")
def test_without_a_structure_the_report_is_of_modes_and_has_no_sentence_on_stiffness(
    tmp_path: Path,
) -> None:
    pytest.importorskip("matplotlib")
    text = page(modes_only(tmp_path, start_ns=START_NS))
    assert "<h1>Modes of t1</h1>" in text
    assert "5 modes between 0.16 and 2.57 Hz were identified in 1 window." in text
    assert "Mode shapes" in text
    for word in ("tiffness", "posterior", "Foundation", "misfit"):
        assert word not in text


@pytest.mark.usefixtures("undrawn")
def test_a_box_of_the_prior_is_named_only_where_there_is_one(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for structure, is_named in (("exact", True), ("uncertain", False)):
        path = recorded(
            tmp_path / f"{structure}.mcap",
            [LAYOUT, estimate(0), replace(posterior(0), structure=structure)],
        )
        text = page(replace(read_session(path), prior=PriorSettings()))
        assert ("prior 0.25 to 4" in text) == is_named


def test_without_a_clock_times_are_counted_from_the_start(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    text = page(modes_only(tmp_path, start_ns=0))
    assert "0:00:00 to 0:08:20 after the start" in text
    assert "time since the start [h:min:s]" in text
    assert not any(year in text for year in ("1968", "1969", "1970", "1971"))


def test_a_track_names_the_mode_of_the_model_that_it_is_paired_with(one: Path) -> None:
    (turbine,) = session_json(read_session(one))["turbines"]
    models = {each["name"]: each["model"] for each in turbine["frequency_tracks"]}
    assert any(models.values())


def test_a_session_lasts_from_its_first_turbines_beginning_to_its_last_ones_end() -> None:
    hours = [h * 3600 * NANOSECONDS for h in (1, 2, 5, 9)]
    spans = ((hours[0], hours[2]), (hours[1], hours[3]))
    records = [SimpleNamespace(span_ns=each) for each in spans]
    session = RecordedSession("a", (Path("a"),), (), {}, None, records)  # type: ignore[arg-type]
    assert between_instants(hours[0], hours[3]) in _provenance(session)


def test_the_cards_have_the_time_of_samples_and_what_several_units_lack_once() -> None:
    """Twice ten minutes with 28 days between them; two units lack one minute together."""
    record, second = TurbineRecord("t1"), NANOSECONDS
    for session_name, later in (("a", 0), ("b", 28 * 86_400)):
        for number in range(0, 600, 20):
            for unit in ("tower", "nacelle"):
                samples = np.zeros((200, 8), np.float32)
                start_ns = START_NS + (later + number) * second
                made = replace(block(number // 20, unit=unit), session=session_name)
                made = replace(made, start_ns=start_ns, first_sample=10 * number, samples=samples)
                record.run.fold(replace(made, sampling_rate=10.0))
    for unit in ("tower", "nacelle"):
        gap = StreamGap("t1", unit, "b", START_NS, START_NS + 60 * second, 1, 60)
        record.run.fold(gap)
    cards = dict(_key_figures(record))
    assert (cards["measured"], cards["missing"]) == ("20 min", "60 s")
    sentences = " ".join(measurement_sentences(record))
    assert "20 min of measurements over 28 d 0 h" in sentences
    assert "2 gaps in the stream, 60 s in all" in sentences
    assert "Between boots of a unit 27 d 23 h have no samples" in sentences


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        made = _recorded(Path(folder) / "session.mcap")
        PAGE.write_text(_said(made, page(read_session(made))), "utf-8")


@pytest.mark.parametrize("content", [b"", b"<!DOCTYPE html>\n<title>an older report</title>"])
@pytest.mark.usefixtures("undrawn")
def test_an_older_report_is_replaced(one: Path, tmp_path: Path, content: bytes) -> None:
    out = tmp_path / "report.html"
    out.write_bytes(content)
    assert CliRunner().invoke(app, ["report", str(one), "-o", str(out)]).exit_code == 0
    assert out.read_bytes().startswith(b"<!doctype html")


def test_no_recording_and_no_layout_is_replaced_by_a_report(one: Path, tmp_path: Path) -> None:
    recording, layout = tmp_path / "session.mcap", tmp_path / "layout.toml"
    shutil.copy(one, recording)
    layout.write_text('turbine = "t1"')
    for out in (recording, layout):
        before = out.read_bytes()
        ran = CliRunner().invoke(app, ["report", str(recording), "-o", str(out)])
        assert isinstance(ran.exception, InputError)
        assert "exists and is no report" in str(ran.exception)
        assert out.read_bytes() == before
