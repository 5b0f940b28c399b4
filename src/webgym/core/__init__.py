"""The nouns that cross rooms. No I/O, and no import from any other room."""
