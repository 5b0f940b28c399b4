"""``webgym bench rollout``: compare the collector's schedules, with a policy of fixed capacity."""
