"""A discrete-event model of a rollout system: ``webgym simulate``. It measures nothing and starts nothing."""
