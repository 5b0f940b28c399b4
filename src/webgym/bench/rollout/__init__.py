"""``webgym bench rollout``: the collector's schedules against each other, with a policy of fixed capacity."""
