"""From a trajectory to a verdict (paper §3.4)."""
