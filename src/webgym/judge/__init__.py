"""From a trajectory to a verdict (paper §3.4)."""

from __future__ import annotations

from webgym.judge.base import Judge, Pictures
from webgym.judge.offline import OfflineJudge

__all__ = ["Judge", "OfflineJudge", "Pictures"]
