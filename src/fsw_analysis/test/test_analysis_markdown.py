"""Tables in Markdown."""

from fsw_analysis.report import table

ROWS = [("", "a long header"), ("x|y", 1)]


def test_numbers_are_flush_right_and_bars_in_cells_escaped():
    assert table(ROWS).splitlines() == ["|  | a long header |", "| --- | ---: |", "| x\\|y | 1 |"]


def test_all_columns_of_words():
    assert table(ROWS, words=None).splitlines()[1] == "| --- | --- |"


def test_padded_columns_line_up():
    lines = table(ROWS, padded=True).splitlines()
    assert (
        len(set(map(len, lines))) == 1 and lines[2].endswith(" 1 |") and lines[1].endswith("-: |")
    )
