"""Reasons of recorded commands.

Of today's messages by their code, of older bags by their words.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fsw_analysis.messages import Table
from fsw_analysis.signals import FIELDS, reasons
from fsw_control.reason import Reason, ReasonCode

NEW = Reason(ReasonCode.BLIND, ("depth",), 3.0)
FAILED = Reason(ReasonCode.FAILED, subject="nmpc")


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ((9.0, ["depth"], 3.0, "", "", [], ""), NEW),
        ((40.0, [], 0.0, "", "nmpc", [], ""), FAILED),
        ((0.0, [], 0.0, "", "", [], ""), Reason()),
        ((99.0, [], 0.0, "", "", [], ""), Reason(ReasonCode.UNKNOWN)),
        ((np.nan, [], np.nan, "", "", [], ""), Reason()),
        (
            (np.nan, [], np.nan, "", "", [], "solver: late"),
            Reason(ReasonCode.OTHER, detail="solver: late"),
        ),
    ],
)
def test_reason_of_a_message(row: tuple[Any, ...], reason: Reason) -> None:
    columns = {}
    for name, value in zip(FIELDS, row, strict=True):
        columns[name] = np.empty(1, object)
        columns[name][0] = value
    assert reasons(Table([(0, 0, 0)], columns)) == [reason]
