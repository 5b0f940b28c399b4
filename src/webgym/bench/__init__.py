"""What prints figures about this machine: ``webgym bench``. Ratios within one run; machines and days differ.

Each module is one sub-verb; none is imported by any other room.
"""
