"""How many sessions one client may hold."""

from __future__ import annotations

import pytest

from webgym.core.errors import TooManySessions
from webgym.server.callers import Quota


def test_a_requested_session_counts() -> None:
    quota = Quota(2)
    with quota.requesting("ann"):
        quota.granted("ann", "1")
    with quota.requesting("ann"):  # still waits in line
        with pytest.raises(TooManySessions, match="2 sessions"), quota.requesting("ann"):
            raise AssertionError
        with quota.requesting("bob"):
            pass
    quota.ended("1")
    quota.ended("1")
    quota.ended("nobody's")
    for name in ("2", "3"):
        with quota.requesting("ann"):
            quota.granted("ann", name)
    with pytest.raises(TooManySessions), quota.requesting("ann"):
        raise AssertionError


def test_no_limit() -> None:
    quota = Quota(None)
    for number in range(1000):
        with quota.requesting("ann"):
            quota.granted("ann", str(number))
