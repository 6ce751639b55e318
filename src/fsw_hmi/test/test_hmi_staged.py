"""Whoever has never seen the page finds cause and next action in its headline and the open alarm."""

from __future__ import annotations

import pytest

from fsw_hmi.alarms import ACTIONS, NEXT_OF_BAG
from fsw_hmi.recording import RecordingState
from fsw_test_support.staged import STAGED, Staged, page_of, sentence

SITUATIONS = [pytest.param(situation, id=name) for name, situation in STAGED.items()]


@pytest.mark.parametrize("staged", SITUATIONS)
def test_headline_has_cause_and_action_and_the_open_alarm_the_same(staged: Staged) -> None:
    rows, shown = page_of(staged)
    about = shown["alarm"] or shown["code"]
    cause = shown["code"] if shown["alarm"] else ""
    assert (about, cause, shown["action"]) == (staged.about, staged.cause, staged.action)
    assert shown["after"] == ACTIONS[staged.after]
    opened = next((row for row in rows if row["id"] == shown["alarm"]), None)
    assert opened is None or opened["action"] == staged.action
    assert (opened is None) == (not shown["alarm"])


def test_causes_and_actions_in_words() -> None:
    said = {name: sentence(page_of(staged)[1]) for name, staged in STAGED.items()}
    assert said == {name: staged.says for name, staged in STAGED.items()}


def test_every_state_of_the_recording_has_its_next_action_when_the_weld_is_done() -> None:
    assert NEXT_OF_BAG.keys() == {str(recording_state) for recording_state in RecordingState}
    assert ACTIONS.keys() >= set(NEXT_OF_BAG.values())
