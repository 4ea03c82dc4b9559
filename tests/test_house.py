"""What a block passes on its way: few files, few moves between them."""

from tests.house import passed_by_first_window

MOST_FILES = 11
MOST_MOVES = 35
MOST_FILES_AT_THE_END = 70  # of the first window, which also builds the model's first modes


def test_a_block_passes_few_files() -> None:
    plain, closing = passed_by_first_window()
    assert len(plain.files) <= MOST_FILES, "\n".join(sorted(plain.files))
    assert plain.moves <= MOST_MOVES
    assert len(closing.files) <= MOST_FILES_AT_THE_END, "\n".join(sorted(closing.files))
