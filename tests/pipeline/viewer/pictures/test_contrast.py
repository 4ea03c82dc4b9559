"""Contrast of text with what is behind it, by WCAG 2: 4.5 wherever it can be reached.

(L1 + 0.05) / (L2 + 0.05), L the relative luminance of the lighter and of the darker colour.
"""

import re
from pathlib import Path

import pytest

from pipeline.report.html import PAGE_STYLE
from pipeline.report.page import page
from pipeline.report.recorded_session import read_session
from pipeline.viewer.pictures import colours
from tests.pipeline.report.example_session import recorded, session

ENOUGH = 4.5
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
DARK_CANVAS = (18, 18, 18)  # of Chromium's dark colour scheme
DARK_LABEL = (22, 22, 22)  # behind a label on black in Rerun's dark theme, of a screenshot
LIGHT_LABEL = (112, 112, 112)  # the same in its light theme
SEEN = 3.0  # of a line or a dot with what is behind it, WCAG 1.4.11


def luminance(colour: tuple[float, ...]) -> float:
    shares = [value / 255 for value in colour]
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def faded(text: tuple[int, ...], behind: tuple[int, ...], opacity: float) -> tuple[float, ...]:
    return tuple(opacity * t + (1 - opacity) * b for t, b in zip(text, behind, strict=True))


@pytest.mark.parametrize(("text", "behind"), [(BLACK, WHITE), (WHITE, DARK_CANVAS)])
def test_the_reports_faded_text_has_contrast_enough(
    text: tuple[int, ...], behind: tuple[int, ...]
) -> None:
    opacities = [float(each) for each in re.findall(r"opacity: ([.\d]+)", PAGE_STYLE)]
    assert opacities
    for opacity in opacities:
        assert contrast(faded(text, behind, opacity), behind) >= ENOUGH


def test_text_in_the_reports_pictures_has_the_pages_own_colour(tmp_path: Path) -> None:
    text = page(read_session(recorded(tmp_path / "session.mcap", session())))
    fills = re.findall(r"<text[^>]*fill: ?([^;\"]+)", text)
    assert set(fills) <= {"currentColor"}
    assert "<text" in text


@pytest.mark.parametrize("ground", [DARK_LABEL, LIGHT_LABEL])
def test_a_label_of_the_viewer_is_read_in_both_themes(ground: tuple[int, ...]) -> None:
    assert contrast(colours.LABEL, ground) >= ENOUGH


def test_lines_and_dots_are_seen_on_the_ground_of_drawings() -> None:
    for colour in {*colours.LEVELS, colours.NEUTRAL}:
        assert contrast(colour, colours.BACKGROUND) >= SEEN
