"""Straight to the worker where that is the same place from here."""

from __future__ import annotations

import pytest

from webgym.server.client import may_connect_directly


@pytest.mark.parametrize(
    ("known", "offered", "may"),
    [
        ("http://127.0.0.1:8700", "http://127.0.0.1:9000", True),
        ("http://localhost:8700", "http://127.0.0.1:9000", True),
        ("http://[::1]:8700", "http://127.0.0.1:9000", True),
        ("http://10.0.0.1:8700", "http://10.0.0.2:9000", True),
        ("http://localhost:8700", "http://10.0.0.2:9000", True),
        ("https://gym.example", "https://10.0.0.2:9000", True),
        # Loopback is somewhere else on every machine.
        ("http://10.0.0.1:8700", "http://127.0.0.1:9000", False),
        ("http://gym.example", "http://127.9.9.9:9000", False),
        ("http://gym.example", "http://[::1]:9000", False),
        ("http://gym.example", "http://localhost:9000", False),
        # A token that travels encrypted is not sent in the clear.
        ("https://gym.example", "http://10.0.0.2:9000", False),
        # The same place, none, nonsense.
        ("http://127.0.0.1:8700", "http://127.0.0.1:8700", False),
        ("http://127.0.0.1:8700", "", False),
        ("http://127.0.0.1:8700", "http://[", False),
    ],
)
def test_where_the_straight_way_may_be_tried(known: str, offered: str, may: bool) -> None:
    assert may_connect_directly(known, offered) is may
