"""The types that packages share. No I/O, and no import from any other package."""
