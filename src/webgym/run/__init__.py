"""A run put together: its settings, services, tasks and collection."""
