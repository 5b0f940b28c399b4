"""``webgym tasks build``: from the sources' files to a split, validated task set."""
