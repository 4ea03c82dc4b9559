"""Which frequencies are drawn, and when they were measured."""

import numpy as np

from pipeline.report.pictures.axes import datetimes, unbroken
from pipeline.report.tracks import FrequencyTrack, most_informative


def track(name: str, information: float, windows: int = 3) -> FrequencyTrack:
    return FrequencyTrack(
        name=name,
        model="",
        model_frequency=float("nan"),
        information=information,
        times_ns=np.arange(windows, dtype=np.int64),
        frequencies=np.ones(windows),
        stds=np.zeros(windows),
    )


def test_tracks_that_tell_most_of_the_foundation_are_drawn_in_the_order_of_frequency() -> None:
    tracks = [track("a", 1.0), track("b", 5.0), track("c", 0.0), track("d", 3.0)]
    assert [each.name for each in most_informative(tracks, 2)] == ["b", "d"]


def test_of_tracks_that_tell_as_much_the_longest_are_drawn() -> None:
    tracks = [track("a", 0.0, 2), track("b", 0.0, 9), track("c", 0.0, 5)]
    assert [each.name for each in most_informative(tracks, 2)] == ["b", "c"]


def test_a_line_breaks_where_windows_are_missing() -> None:
    times = datetimes([0, 600, 1200, 5400, 6000])
    assert [piece.tolist() for piece in unbroken(times)] == [[0, 1, 2], [3, 4]]
    assert [piece.tolist() for piece in unbroken(datetimes([7]))] == [[0]]
