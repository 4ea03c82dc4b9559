"""What a stranger wrote is printed, not obeyed."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from pipeline.cli.console import escape_markup, zenoh_settings
from sensors.errors import InputError


@given(st.text(alphabet=r"\[]/ab"))
def test_no_text_is_markup_whatever_it_holds(text: str) -> None:
    """Of backslashes before a bracket rich may print one more."""
    printed = Text.from_markup(escape_markup(text))
    assert printed.plain.replace("\\", "") == text.replace("\\", "")
    assert not printed.spans


def test_a_file_of_zenohs_sets_the_mode_and_no_option_besides() -> None:
    file = Path("zenoh.json5")
    assert zenoh_settings("peer", None, None, file).config_file == file
    assert zenoh_settings("client", None, ["tcp/a:1"], None).connect == ("tcp/a:1",)
    with pytest.raises(InputError, match="--mode client and --zenoh-config"):
        zenoh_settings("client", None, None, file)
