"""The publication's example in a short form, and the report that is made of it."""

import csv
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from pipeline.reproduction import example as reproduction
from pipeline.reproduction.example import Example, PublishedDensity, run_example
from pipeline.reproduction.findings import findings, over_seeds
from pipeline.reproduction.page import prepared_folder, table2, write_report
from pipeline.reproduction.paper import LABELS, TABLE_1
from pipeline.reproduction.study import Study, lowest_start, n_peaks
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.samplers.tmcmc import TemperingSettings
from sensors.errors import InputError
from tests.pipeline.updating.likelihood.joint_density import JointDensity
from tests.pipeline.updating.likelihood.test_posterior_density import (
    PRIOR,
    TOWER,
    TRUTH,
    likelihood_of_one_window,
)

# Of the corrected sampler's stages a third of the report's particles lead to the mixture from which
# it draws: the draws are as many, and weighted as exactly.
SAMPLES = 2000  # of TMCMC; the report has 100 000, and of 1000 a kernel makes a second peak


@pytest.fixture(scope="module")
def run() -> tuple[Example, list[float]]:
    """The example, and the progress that it reported."""
    shares: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction, "TemperingSettings", partial(TemperingSettings, particles=300))
        made = run_example(101, "published", samples=SAMPLES, report=shares.append)
    return made, shares


@pytest.fixture(scope="module")
def example(run: tuple[Example, list[float]]) -> Example:
    return run[0]


@pytest.fixture(scope="module")
def study(example: Example) -> Study:
    """Two seeds in both signs, made of one run: what is under test is the report."""
    examples = [
        replace(example, sign=sign, seed=seed)
        for sign in ("published", "embedded-pile")
        for seed in (101, 102)
    ]
    return Study(tuple(examples), SAMPLES)


def test_the_publications_density_is_the_one_read_off_a_grid_of_sigma() -> None:
    settings = LikelihoodSettings(
        frequency_floor=0.0, shape_floor=0.0, tails="gaussian", sigma_points=400
    )
    likelihood = likelihood_of_one_window(settings)
    generator = np.random.default_rng(4)
    points = np.column_stack([TRUTH * generator.normal(1, 0.05, (50, 3)), np.full(50, 0.01)])
    points[:, 3] *= generator.uniform(0.1, 5, 50)
    ours = PublishedDensity(likelihood, TOWER, PRIOR)(points)[0]
    grid = JointDensity(likelihood, TOWER, PRIOR)(points)[0]
    inside = np.isfinite(grid)
    assert inside.sum() > 30
    constant = ours[inside][0] - grid[inside][0]
    np.testing.assert_allclose(ours[inside] - grid[inside], constant, atol=0.02)


def test_the_modes_that_were_found_are_near_those_of_the_model(example: Example) -> None:
    found = [mode for mode in example.modes if np.isfinite(mode.frequency)]
    assert len(found) >= 6
    for mode in found:
        error = abs(mode.frequency - mode.model_frequency)
        assert error < max(5 * mode.frequency_std, 0.005 * mode.model_frequency)
    assert tuple(mode.label for mode in example.modes) == LABELS


def test_the_model_reproduces_table_1_within_two_percent(example: Example) -> None:
    for ours, printed in zip(example.modes, TABLE_1, strict=True):
        assert ours.model_frequency == pytest.approx(printed.model_frequency, rel=0.02)


def test_the_posterior_has_one_peak_near_the_truth_and_positive_correlations(
    example: Example,
) -> None:
    assert n_peaks(example.corrected) == 1
    assert np.all(example.corrected.correlations > 0.3)
    assert np.all(np.abs(example.corrected.highest[:3] - 1) < 0.12)
    assert np.all(np.abs(example.corrected.draws[:, :3].mean(axis=0) - 1) < 0.12)


def test_every_start_of_the_simplex_is_reported(example: Example) -> None:
    assert [descent.start[0] for descent in example.descents] == [0.25, 1.0, 4.0]
    assert lowest_start(example) in (0.25, 1.0, 4.0)
    assert min(d.objective for d in example.descents) <= example.objective_at_truth


def test_the_report_holds_both_tables_and_explains_every_difference(
    study: Study, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    files = write_report(study, tmp_path / "report")
    assert {path.name for path in files} == {
        "report.md", "report.html", "figure3.png", "table1.csv", "table2.csv",
    }  # fmt: skip
    with (tmp_path / "report" / "table1.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert [row[0] for row in rows[1:]] == list(LABELS)
    assert rows[5][4] == "1.0890" or rows[4][4] == "1.0890"  # mode 4 as printed
    text = (tmp_path / "report" / "report.md").read_text(encoding="utf-8")
    assert "the structure taken as exactly known" in text
    for mode in study.first.modes:
        if not np.isfinite(mode.frequency):
            assert f"Not mode {mode.label}:" in text
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert_stands_alone(page)
    for sentence in findings(study):
        assert sentence in text


def assert_stands_alone(page: str) -> None:
    """Nothing is fetched: every source is inside the page."""

    class Sources(HTMLParser):
        found: list[str]

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.found += [value or "" for name, value in attrs if name in ("src", "href")]

    parser = Sources()
    parser.found = []
    parser.feed(page)
    assert parser.found
    assert all(source.startswith("data:") for source in parser.found)


@pytest.mark.parametrize(("apart", "peaks"), [(0.0, 1), (1.5, 1), (5.0, 2)])
def test_a_peak_stands_out_of_its_valleys(example: Example, apart: float, peaks: int) -> None:
    """Two normal densities 1.5 standard deviations apart have one maximum, 5 apart two."""
    draws = np.random.default_rng(3).standard_normal((2000, 4))
    draws[:700, 0] += apart
    assert n_peaks(replace(example.corrected, draws=draws)) == peaks


def test_many_seeds_are_in_one_table(study: Study) -> None:
    table = dict(over_seeds(study.of("published")))
    assert table["found, modes 1 to 11"].count(" ") == 10
    assert table["seeds with a single peak"] == "2"
    assert table["of pilewatch's own likelihood, Gaussian at its peak"] == "2 / 2 / 2"


def test_a_report_that_cannot_be_written_is_one_clear_line(study: Study, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"a folder to write to is needed"):
        write_report(study, tmp_path / "file")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="a folder that takes no file")
def test_a_folder_that_takes_no_file_is_refused_before_the_study() -> None:
    with pytest.raises(InputError, match=r"--out /proc: .* a folder to write to is needed"):
        prepared_folder(Path("/proc"))


def with_correlation(example: Example, value: float) -> Example:
    """The example with a posterior whose springs are correlated by so much."""
    generator = np.random.default_rng(9)
    common, own = generator.standard_normal((2, len(example.corrected.draws), 3))
    mixed = np.sqrt(abs(value)) * common[:, :1] * np.sign([1.0, value, 1.0])
    draws = example.corrected.draws.copy()
    draws[:, :3] = 1 + 0.01 * (mixed + np.sqrt(1 - abs(value)) * own)
    return replace(example, corrected=replace(example.corrected, draws=draws))


def said_of(example: Example, *others: Example) -> str:
    return " ".join(findings(Study((example, *others), SAMPLES)))


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.9, "strongly positive"), (0.3, "not all strongly"), (-0.8, "not all are positive")],
)
def test_a_correlation_is_called_what_it_is(example: Example, value: float, said: str) -> None:
    text = said_of(with_correlation(example, value))
    assert said in text
    assert (
        sum(each in text for each in ("strongly positive", "not all strongly", "not all are p"))
        == 1
    )


def test_samplers_that_agree_are_not_said_to_differ(example: Example) -> None:
    alike = replace(example, published=example.corrected)
    assert "here the two agree" in said_of(alike)
    narrow = replace(example.corrected, draws=1 + 0.5 * (example.corrected.draws - 1))
    assert "leaves it too wide" not in said_of(replace(example, published=narrow))


def test_starts_that_end_at_one_place_are_not_said_to_differ(example: Example) -> None:
    first = example.descents[0]
    same = tuple(replace(each, end=first.end) for each in example.descents)
    assert "all starts end at one place" in said_of(replace(example, descents=same))


def test_a_pile_sign_that_knows_as_much_is_not_said_to_know_less(example: Example) -> None:
    text = said_of(example, replace(example, sign="embedded-pile"))
    assert "less sharply" not in text
    assert "taken literally it reproduces" not in text  # both signs fit alike: the same model


def with_draws(example: Example, middle: float, std: float) -> Example:
    """The example with springs at some ratio to the truth, so well known."""
    draws = example.corrected.draws.copy()
    draws[:, :3] = np.random.default_rng(9).normal(middle, std, draws[:, :3].shape)
    return replace(example, corrected=replace(example.corrected, draws=draws))


def test_each_sign_states_with_one_seed_whether_its_intervals_hold(example: Example) -> None:
    pile = replace(with_draws(example, 1.0, 0.2), sign="embedded-pile")
    text = said_of(with_draws(example, 1.0, 0.01), pile)
    for sign in ("published", "embedded-pile"):
        assert f"Seed 101, {sign} sign: means of k11, k22, k12" in text
    assert text.count("the 90 % intervals of all three springs hold it") == 2
    assert "times less sharply" in text


def test_a_sign_whose_intervals_miss_is_not_said_to_know_less(example: Example) -> None:
    pile = replace(with_draws(example, 0.7, 0.04), sign="embedded-pile")
    text = said_of(with_draws(example, 1.0, 0.01), pile)
    assert "the 90 % intervals miss it for k11, k22 and k12" in text
    assert "times less sharply" not in text
    assert "is not concluded from them: intervals of the embedded-pile sign miss" in text


@pytest.mark.parametrize(
    ("shape", "frequency", "said"),
    [
        (9.1, 0.5, "most the shape of mode 6, by 9.1"),
        (1.0, 8.2, "most the frequency of mode 6, by 8.2"),
    ],
)
def test_why_intervals_miss_is_read_off_the_identified_modes(
    example: Example, shape: float, frequency: float, said: str
) -> None:
    modes = [
        replace(
            mode,
            shape_deviation=shape,
            frequency=mode.model_frequency + frequency * mode.frequency_std,
        )
        if mode.label == "6"
        else mode
        for mode in example.modes
    ]
    missed = replace(with_draws(example, 0.8, 0.02), modes=tuple(modes), left_out="6")
    text = said_of(replace(missed, deviation=1.7))
    assert said in text
    assert "off by 1.7 of their SSI-cov standard deviations rms" in text
    assert "Eq. 9 takes them for the whole error" in text
    assert "it is mode 6 without which the peak is nearest to it" in text
    assert "pilewatch's own likelihood" in text
    honest = said_of(replace(missed, deviation=1.0, left_out=""))
    assert "whole error, and" not in honest
    assert "left out in turn" not in honest


def test_the_mode_that_is_left_out_brings_the_peak_nearer(example: Example) -> None:
    assert example.deviation > 1
    assert example.without.ratios == pytest.approx(np.ones(3), abs=0.05)
    assert example.own_peak.ratios == pytest.approx(np.ones(3), abs=0.05)
    every = np.abs(example.corrected.draws[:, :3].mean(axis=0) - 1).max()
    assert np.abs(example.without.ratios - 1).max() <= every + 0.005


def test_modes_of_a_pair_are_listed_and_not_called_separated(example: Example) -> None:
    """Of seed 101 modes 1 and 2 are a pair: one shape is a good one by chance."""
    first, second = example.modes[:2]
    assert np.isfinite([first.frequency, second.frequency]).all()
    assert first.unresolved
    assert second.unresolved
    text = said_of(example)
    assert "Mode 4 is separated here" in text
    assert "Mode 1 is not separated here" in text


@pytest.mark.parametrize(("mac", "separated"), [(0.15, False), (0.45, False), (0.95, True)])
def test_a_mode_is_called_separated_by_its_own_shape(
    example: Example, mac: float, separated: bool
) -> None:
    modes = tuple(
        replace(mode, mac=mac, unresolved=False) if mode.label in ("1", "4") else mode
        for mode in example.modes
    )
    text = said_of(replace(example, modes=modes))
    assert ("Modes 1 and 4 are separated here" in text) == separated
    assert "not separated" not in text


def test_identified_modes_without_a_partner_are_not_said_to_be_the_models(
    example: Example,
) -> None:
    text = said_of(replace(example, others=23, unpaired=8))
    assert "23 others of the model" in text
    assert "the remaining 8 identified modes are paired with no mode of the model" in text


def test_a_start_that_runs_away_is_said_to_and_has_no_percents(example: Example) -> None:
    first, second, third = example.descents
    away = replace(third, end=np.array([1e8, 4e6, 3e7]))
    ran = replace(example, descents=(first, second, away))
    text = said_of(ran)
    assert "γ = 4 runs away to rigid springs at J = " in text
    assert "+223 +337 +366 %" in text
    assert "From γ = 4 J falls towards a rigid base" in text
    rows = [row for row in table2(Study((ran,), SAMPLES)).rows if "γ = 4" in row[0]]
    assert rows[1][2:5] == ("to rigid",) * 3
    assert rows[0][2] == "+222.79"
    kept = replace(third, end=np.array([4.0, 4.5, 4.2]))
    assert "runs away" not in said_of(replace(example, descents=(first, second, kept)))


def test_why_a_mode_is_missing_is_read_off_the_models_frequencies(example: Example) -> None:
    nothing = [replace(mode, frequency=float("nan")) for mode in example.modes]
    text = said_of(replace(example, modes=tuple(nothing)))
    assert "Not mode 1: it lies 0.001" in text
    assert "less than the 0.0017 Hz that ten minutes resolve" in text
    apart = [replace(mode, model_frequency=1.5 ** int(mode.label)) for mode in nothing]
    assert "ten minutes resolve" not in said_of(replace(example, modes=tuple(apart)))


def test_modes_are_paired_without_the_truth(example: Example) -> None:
    """Of a stiffness far from nominal the same search finds the same modes."""
    labels = {mode.label for mode in example.modes if np.isfinite(mode.frequency)}
    assert {"2", "5", "6", "9"} <= labels


def test_progress_rises_to_one_for_each_run(run: tuple[Example, list[float]]) -> None:
    _, shares = run
    assert shares == sorted(shares)
    assert shares[0] < 0.1
    assert shares[-1] > 0.7
