"""A ROS domain for the tests of nodes."""

import pytest

from fsw_control.free_domain import free_domain


@pytest.fixture
def domain_id(monkeypatch):
    """A ROS domain that no other test on this machine uses now."""
    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain
