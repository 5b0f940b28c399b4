"""Construction of a task set from public sources: reading, rubrics, decomposition, checks."""
