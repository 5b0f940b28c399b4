"""A run on disk: its files, records, verdicts and their verification."""
