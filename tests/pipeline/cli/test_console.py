"""What is printed, and how it is folded; untrusted text is no markup."""

from io import StringIO
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from pipeline.cli.console import LineConsole, escape_markup, zenoh_settings
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


def test_a_long_sentence_is_one_line_where_the_output_is_no_terminal() -> None:
    written = StringIO()
    LineConsole(file=written, width=40).print("word " * 40)
    LineConsole(file=written, width=40, force_terminal=True).print("word " * 40)
    first, *rest = written.getvalue().splitlines()
    assert first.count("word") == 40
    assert len(rest) > 1
