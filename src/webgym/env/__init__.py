"""The environment: reset, step and a reward, for one's own policy or trainer."""
