"""Models that learn from tuples: networks, losses, training, and the poses that they store."""
