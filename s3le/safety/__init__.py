"""What proves a motion: the proof for paths, the audit of a whole motion, the second opinion."""
