"""Task sets: reading and writing them, and choosing from them."""
