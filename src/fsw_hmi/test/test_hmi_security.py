"""Whom limits count, and who is on this computer."""

import pytest

from fsw_hmi.security import client_of, is_loopback


@pytest.mark.parametrize(
    ("address", "client", "local"),
    [
        ("127.0.0.1", "127.0.0.1", True),
        ("127.3.2.1", "127.3.2.1", True),
        ("::1", "::/64", True),
        ("::ffff:127.0.0.1", "127.0.0.1", True),
        ("192.0.2.4", "192.0.2.4", False),
        ("::ffff:192.0.2.4", "192.0.2.4", False),
        ("2001:db8::1:2:3:4", "2001:db8::/64", False),
        ("fe80::1%eth0", "fe80::/64", False),
        ("localhost", "localhost", False),
        ("", "", False),
    ],
)
def test_client_of_an_address(address, client, local):
    assert (client_of(address), is_loopback(address)) == (client, local)
