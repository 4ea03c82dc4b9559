"""What a block passes on its way: few files, few moves between them."""

from tests.house import passed_within_a_window

MOST_FILES = 16
MOST_MOVES = 35


def test_a_block_within_a_window_passes_few_files() -> None:
    passed = passed_within_a_window(60)
    assert len(passed.files) <= MOST_FILES, "\n".join(sorted(passed.files))
    assert passed.moves <= MOST_MOVES
