"""`import pilewatch`: arrays and files in, modes and posteriors out, in a handful of lines."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal
from threadpoolctl import threadpool_info, threadpool_limits

from pipeline.messages import FoundationPosterior, ParameterSummary
from pipeline.offline.identify_file import identify_file
from pipeline.recording.reader import read_messages
from tests.pipeline.state.test_posterior_json import POSTERIOR

pw = pytest.importorskip("pilewatch", reason="the project is not installed")
pytestmark = pytest.mark.usefixtures("identified_once")


@pytest.fixture(scope="module")
def measurement(short_recording: Path) -> "pw.Measurement":
    return pw.read(short_recording)


@pytest.fixture(scope="module")
def modes(measurement: "pw.Measurement") -> "pw.Modes":
    """Of every second sample: a third fewer modes, each of which takes its time."""
    slow = signal.decimate(measurement.samples, 2, axis=0)
    return pw.identify(slow, 20.0, window=240.0, layout=measurement.layout)


@pytest.fixture(scope="module")
def posterior(modes: "pw.Modes") -> "pw.Posterior":
    return pw.update(modes, pw.Structure())


def test_a_recording_is_read_with_the_places_of_its_channels(
    measurement: "pw.Measurement",
) -> None:
    assert measurement.samples.shape == (9600, 8)
    assert measurement.sampling_rate == 40.0
    assert measurement.layout is not None
    assert measurement.layout.channel_names == measurement.channels
    assert repr(measurement) == "<Measurement: 8 channels, 240 s at 40 Hz>"


def test_an_array_and_a_turbine_give_a_posterior_in_four_lines(
    posterior: "pw.Posterior",
) -> None:
    assert posterior.draws.shape[1] == 3
    low, high = np.quantile(posterior.ratios, [0.05, 0.95], axis=0)
    assert np.all((low < 1) & (high > 1))
    assert np.all((high - low)[:2] < 1)  # four minutes report little
    # and of k12 without a reported level: less than half of what was possible beforehand is left
    assert posterior.message.parameters[2].contraction > 0.5
    assert "× nominal" in repr(posterior)


def test_the_library_gives_the_posterior_of_the_session(
    short_session: Path, short_recording: Path
) -> None:
    session = pw.open(short_session)
    recorded = list(read_messages(short_session, (FoundationPosterior,)))
    assert len(session.posteriors) == len(recorded) == 2
    assert session.posterior is session.posteriors[1]
    assert replace(session, posteriors=session.posteriors * 2).posterior is session.posteriors[1]
    assert replace(session, posteriors=session.posteriors[:1]).posterior is session.posteriors[0]
    assert replace(session, posteriors=()).posterior is None
    assert session.posterior is not None
    np.testing.assert_array_equal(session.posterior.message.draws, recorded[-1].draws)
    k22 = recorded[-1].parameter("k22")
    row = session.to_dataframe().iloc[-1]
    assert row["k22_p95"] == pytest.approx(k22.p95 / k22.nominal, rel=1e-12)
    from_modes = pw.update(session.modes, scenario=short_recording)
    np.testing.assert_array_equal(from_modes.draws, session.posterior.draws)
    assert from_modes.message.figures == session.posterior.message.figures != ()


def test_an_exact_structure_is_a_choice_that_is_written_down(
    modes: "pw.Modes",
    posterior: "pw.Posterior",
) -> None:
    exact = pw.update(modes, pw.Structure(), exact=True)
    assert posterior.message.figures
    assert not exact.message.figures
    assert np.all(np.std(exact.ratios, axis=0) < np.std(posterior.ratios, axis=0))
    np.testing.assert_allclose(np.median(exact.ratios, axis=0), 1.0, atol=0.1)


def test_a_structure_is_never_assumed(modes: "pw.Modes") -> None:
    with pytest.raises(pw.InputError, match="which structure is it"):
        pw.update(modes)


def test_a_file_gives_the_modes_and_warnings_that_the_command_gives(tmp_path: Path) -> None:
    noise = np.random.default_rng(5).standard_normal((3000, 2))
    times = np.arange(3000) / 20.0
    times[1500:] += 7.0  # seconds that the logger lost
    file = tmp_path / "gap.csv"
    rows = np.column_stack([times, noise])
    np.savetxt(file, rows, delimiter=",", header="t [s],a [m/s²],b [m/s²]", comments="")
    command, library = identify_file(file), pw.identify(file)
    assert library.warnings == command.warnings
    assert [mode.frequency for mode in library.last] == [
        mode.frequency for each in command.estimates[-1:] for mode in each.modes
    ]
    assert pw.read(file).times[-1] == pytest.approx(times[-1])
    assert pw.read(file).between(70.0, 90.0).samples.shape == (260, 2)


def test_frequencies_of_an_array_need_no_names_and_no_places() -> None:
    generator = np.random.default_rng(7)
    modes = pw.identify(generator.standard_normal((6000, 2)), sampling_rate=20.0)
    assert modes.channels == ("ch1", "ch2")
    assert len(modes.estimates) + len(modes.rejected) == 1


@pytest.mark.parametrize(
    ("samples", "rate", "said"),
    [
        (np.zeros((10, 2, 2)), 40.0, "of shape"),
        (np.zeros((1000, 2)), 0.0, "sampling_rate is 0"),
        (np.zeros((1000, 2)), None, "sampling_rate is None"),
        (np.zeros((1000, 2)), "20", "sampling_rate is '20'"),
        (np.zeros((1000, 2)), 20j, "sampling_rate is 20j"),
        (np.zeros((1000, 2)), True, "sampling_rate is True"),
        (np.zeros((0, 2)), 40.0, "of shape"),
        (np.zeros((2, 1000)), 40.0, "transpose"),
        (np.zeros((1000, 2), dtype=complex), 40.0, "complex"),
        (np.array([["a"]]), 40.0, "real numbers"),
        (None, 40.0, "of shape"),
    ],
)
def test_an_array_that_cannot_be_understood_is_refused_in_one_line(
    samples: np.ndarray, rate: Any, said: str
) -> None:
    with pytest.raises(pw.InputError, match=said):
        pw.identify(samples, rate)


def test_a_window_that_is_no_number_is_refused_in_one_line() -> None:
    with pytest.raises(pw.InputError, match="window is '10min'"):
        pw.identify(np.zeros((1000, 2)), 20.0, window="10min")  # type: ignore[arg-type]


def test_a_masked_sample_is_a_missing_one_and_none_is_a_mode() -> None:
    masked = np.ma.masked_all((1000, 2))
    found = pw.identify(masked, 20.0)
    assert not len(found)
    assert "missing or no numbers" in repr(found)


def test_a_tables_columns_and_time_stamps_are_names_and_rate() -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    stamps = pandas.date_range("2024-01-01", periods=6000, freq="50ms")
    noise = np.random.default_rng(3).standard_normal((6000, 2))
    found = pw.identify(pandas.DataFrame(noise, index=stamps, columns=["low", "high"]))
    assert found.channels == ("low", "high")
    (answer,) = (*found.estimates, *found.rejected)
    assert answer.start_ns == stamps[0].value


def test_a_tables_missing_rows_are_a_gap_whatever_its_time_zone() -> None:
    pandas = pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    stamps = pandas.date_range("2024-01-01", periods=6000, freq="50ms", tz="Europe/Berlin")
    noise = np.random.default_rng(3).standard_normal((6000, 2))
    whole = pandas.DataFrame(noise, index=stamps, columns=["low", "high"])
    found = pw.identify(pandas.concat([whole[:2000], whole[4000:]]))
    assert [each.code for each in found.rejected] == ["gap"]
    assert found.rejected[0].start_ns == stamps[0].value


def test_a_file_is_identified_without_its_columns_of_wind_and_power(tmp_path: Path) -> None:
    path = tmp_path / "tower.csv"
    noise = np.random.default_rng(4).standard_normal((6000, 2))
    table = np.column_stack([np.arange(6000) / 20, noise, np.zeros(6000)])
    np.savetxt(path, table, delimiter=",", header="time [s],a1,a2,Power [kW]", comments="")
    found = pw.identify(path)
    assert found.channels == ("a1", "a2")
    assert "measured in kW" in str(found.warnings)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: pw.read(np.zeros(3)),
        lambda: pw.update(np.zeros((3, 3)), pw.Structure()),
        lambda: pw.Structure().modes((1.0, 1.0)),
    ],
)
def test_a_thing_of_another_kind_is_refused_in_one_line(wrong: Callable[[], object]) -> None:
    with pytest.raises(pw.InputError):
        wrong()


def test_a_posterior_without_places_of_the_channels_is_refused() -> None:
    modes = pw.identify(np.random.default_rng(1).standard_normal((6000, 2)), 20.0)
    with pytest.raises(pw.InputError, match="where the channels are"):
        pw.update(modes, pw.Structure())


def test_modes_of_the_structure_are_those_of_table_1() -> None:
    modes = pw.Structure().modes()
    first = dict(zip(modes.labels, modes.frequencies, strict=True))
    assert first["1"] == pytest.approx(0.1573, rel=2e-3)
    assert first["11"] == pytest.approx(12.12, rel=1e-2)


def test_tables_arrays_and_plots_are_those_of_the_field(
    measurement: "pw.Measurement", modes: "pw.Modes", posterior: "pw.Posterior", short_session: Path
) -> None:
    pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    pytest.importorskip("arviz", reason="the extra `notebook` is not installed")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    structure, session = pw.Structure(), pw.open(short_session)
    assert measurement.between(10.0, 20.0).to_xarray().sizes == {"time": 400, "channel": 8}
    assert modes.to_xarray()["shape"].dims == ("mode", "channel")
    assert structure.modes().to_xarray()["frequency"].to_series().is_monotonic_increasing
    assert len(structure.to_dataframe()) == 20
    assert session.to_xarray()["k11"].dims == ("time", "quantile")
    assert posterior.to_inference_data()["posterior"]["k12"].shape == (1, len(posterior.draws))
    assert posterior.plot().shape == (3, 3)
    assert session.plot().shape == (3,)
    assert len(structure.modes().plot(6).flat) == 6
    assert len(modes.plot_shapes().flat) >= len(modes)
    drawn = measurement.plot()
    assert [each.get_ylabel() for each in drawn] == [f"{c}\n[m/s²]" for c in measurement.channels]
    assert structure.plot().get_ylabel().startswith("elevation")
    pyplot.close("all")


def test_a_part_that_holds_nothing_is_refused(measurement: "pw.Measurement") -> None:
    with pytest.raises(pw.InputError, match="nothing lies between 900 and 990 s"):
        measurement.between(900.0, 990.0)


def test_tables_have_a_row_a_mode_and_a_parameter(
    modes: "pw.Modes", posterior: "pw.Posterior"
) -> None:
    pytest.importorskip("pandas", reason="the extra `notebook` is not installed")
    table = modes.to_dataframe()
    last = table[table["window"] == table["window"].max()]
    np.testing.assert_array_equal(last["frequency_hz"], modes.frequencies)
    assert list(posterior.to_dataframe().index[:3]) == ["k11", "k22", "k12"]


def test_a_posterior_reads_as_median_and_half_of_its_90_percent_interval() -> None:
    """Those that summary, export and report give too: of all draws, not of those that are kept."""
    springs = tuple(
        ParameterSummary(name, "N/m", nominal, nominal, 0.9 * nominal, 1.2 * nominal, 0.5)
        for name, nominal in (("k11", 2.0), ("k22", 3.0), ("k12", 4.0))
    )
    message = replace(POSTERIOR, parameters=springs)
    read = pw.Posterior(message, np.array([2.0, 3.0, 4.0]))
    np.testing.assert_allclose(read.quantiles, np.outer([0.9, 1.0, 1.2], np.ones(3)))
    shown = "k11 1.000 ± 0.150, k22 1.000 ± 0.150, k12 1.000 ± 0.150"
    assert repr(read).startswith(f"<Posterior: {shown} × nominal (90 %)")


def test_what_is_computed_is_computed_in_one_thread_on_any_machine(
    modes: "pw.Modes", monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: dict[str, set[int]] = {}

    def noted(name: str) -> Callable[..., None]:
        def note(*_: object, **__: object) -> None:
            threads[name] = {each["num_threads"] for each in threadpool_info()}
            raise pw.InputError(name)

        return note

    monkeypatch.setattr("pipeline.offline.identify_file.identify_table", noted("identify"))
    monkeypatch.setattr("pipeline.sources.sources.simulated", noted("simulate"))
    monkeypatch.setattr(pw.Structure, "model", noted("modes"))
    monkeypatch.setattr("pilewatch.posterior.updated", noted("update"))
    with threadpool_limits(limits=2):
        for door in (
            lambda: pw.identify(np.ones((400, 2)), 10.0),
            pw.simulate,
            pw.Structure().modes,
            lambda: pw.update(modes, pw.Structure()),
        ):
            with pytest.raises(pw.InputError):
                door()
    assert threads == {name: {1} for name in ("identify", "simulate", "modes", "update")}


def test_a_file_keeps_the_rate_of_its_stamps_whatever_rate_is_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = "".join(f"{i / 50:.3f},{i % 7}.5\n" for i in range(200))
    (tmp_path / "tower.csv").write_text("time,z145-fa\n" + rows)
    assert pw.read(tmp_path / "tower.csv", sampling_rate=40.0).sampling_rate == 50.0
    assert "its own time is followed" in caplog.text
