"""Domains of short-lived graphs."""

from __future__ import annotations

import subprocess
import sys
from contextlib import ExitStack

import pytest

from fsw_control.free_domain import NoFreeDomainError, free_domain


def test_every_graph_has_a_domain_of_its_own_until_it_ends() -> None:
    with ExitStack() as stack:
        taken = [stack.enter_context(free_domain()) for _ in range(5)]
        program = (
            "from fsw_control.free_domain import free_domain\n"
            "with free_domain() as domain: print(domain)"
        )
        others = [
            int(
                subprocess.run(
                    [sys.executable, "-c", program], capture_output=True, check=True
                ).stdout
            )
            for _ in range(2)
        ]
        assert len({*taken, *others}) >= 6 and not set(taken) & set(others)


def test_no_domain_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    with free_domain() as domain:
        monkeypatch.setattr("fsw_control.free_domain._DOMAINS", range(domain, domain + 1))
        with pytest.raises(NoFreeDomainError), free_domain():
            pass
    with free_domain() as again:
        assert again == domain
