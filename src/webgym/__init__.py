"""WebGym: a training environment for visual web agents (arXiv 2601.02439)."""

from __future__ import annotations

__version__ = "0.1.0"
