"""What a stranger wrote is printed, not obeyed."""

from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from pipeline.cli.console import escape_markup


@given(st.text(alphabet=r"\[]/ab"))
def test_no_text_is_markup_whatever_it_holds(text: str) -> None:
    """Of backslashes before a bracket rich may print one more."""
    printed = Text.from_markup(escape_markup(text))
    assert printed.plain.replace("\\", "") == text.replace("\\", "")
    assert not printed.spans
