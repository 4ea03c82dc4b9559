"""The report as JSON: `pilewatch report --json`. Names are stable; more may be added."""

from pipeline.report.recorded_session import RecordedSession, TurbineRecord
from pipeline.report.sentences import condition, findings, headline, reasons_for_distrust
from pipeline.report.tracks import FrequencyTrack, frequency_tracks
from pipeline.state.posterior_json import stiffness_summary
from sensors.json_values import Json, fields_of, known, with_nulls


def session_json(session: RecordedSession) -> Json:
    """Return everything on the page; times [ns since 1970-01-01 UTC], unknown values None."""
    return {
        "session": session.name,
        "files": [str(file) for file in session.files],
        "settings": {section: dict(texts) for section, texts in session.metadata.items()},
        "turbines": [_turbine(record) for record in session.turbines],
    }


def _turbine(record: TurbineRecord) -> Json:
    """Return `summary.json` without source and timing, with sentences and values over time."""
    summary = record.figures
    del summary["timing"]
    start_ns, end_ns = record.span_ns
    return summary | {
        "condition": condition(record),
        "headline": headline(record),
        "distrust": reasons_for_distrust(record.state.posterior),
        "findings": findings(record),
        "start_ns": start_ns,
        "end_ns": end_ns,
        "stiffness_over_time": _stiffness_over_time(record),
        "frequency_tracks": [_track(track) for track in frequency_tracks(record)],
    }


def _stiffness_over_time(record: TurbineRecord) -> list[Json]:
    return [
        fields_of(posterior, "time_ns", "window", "trusted", "change_probability")
        | {
            spring.name: stiffness_summary(spring, record.true_stiffness(spring.name, time_ns))
            for spring in posterior.parameters
            if spring.name != "sigma"
        }
        for time_ns, posterior in sorted(record.state.posteriors.items())
    ]


def _track(track: FrequencyTrack) -> Json:
    return {
        "name": track.name,
        "model": track.model or None,
        "model_frequency_hz": known(track.model_frequency),
        "time_ns": track.times_ns.tolist(),
        "frequency_hz": with_nulls(track.frequencies.tolist()),
        "frequency_std_hz": with_nulls(track.stds.tolist()),
    }
