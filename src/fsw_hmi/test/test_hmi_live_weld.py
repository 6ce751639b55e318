"""The weld so far, as the page judges it."""

from math import nan

from fsw_analysis.rule_book import default
from fsw_hmi.frames import COLUMNS
from fsw_hmi.live_weld import LiveWeld
from fsw_hmi.weld_view import Row


def test_samples_of_the_first_tick_may_be_missing():
    weld = LiveWeld(default())
    for number in range(3):
        weld.add(Row(number * 10**8, (nan,) * (len(COLUMNS) - 1)), "nmpc")
        assert (weld.account() is None) is (number == 0)
