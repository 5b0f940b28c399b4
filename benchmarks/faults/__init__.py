"""A run under random faults, beside the same run without them: rewards must not differ."""
