"""Learning from judged trajectories (paper §5): replay, samples, objectives and the update.

Modules that compute need the extra ``train``; ``import webgym`` and ``webgym --help`` load none of them.
"""
