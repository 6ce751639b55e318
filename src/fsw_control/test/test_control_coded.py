"""Codes with a text: their value is the member's name, unless it has one of its own."""

from fsw_control.coded import Worded


class Answer(Worded):
    TOO_LATE = "{time_s:g} s too late"
    UPPER = "upper_bound", "at its bound"


def test_value_is_the_name_or_its_own() -> None:
    assert [*map(str, Answer)] == ["too_late", "upper_bound"]
    assert Answer("too_late").words.format(time_s=2.0) == "2 s too late"
    assert Answer.UPPER.words == "at its bound"
