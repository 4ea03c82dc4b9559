"""Legends stay within their axes."""

from pipeline.report.pictures.identification import LONG_NAME, shortened


def test_a_long_name_loses_its_middle() -> None:
    assert shortened("z145-fa") == "z145-fa"
    assert shortened("Acceleration top 92 m langskibs") == "Acceleration …2 m langskibs"
    assert len(shortened(80 * "x")) == LONG_NAME + 1
