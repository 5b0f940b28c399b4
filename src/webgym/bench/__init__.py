"""Benchmarks of this machine: ``webgym bench``. Results are compared as ratios within one run.

``server.py`` and ``rollout/`` are the sub-verbs. Only :mod:`webgym.cli` imports this package.
"""
