"""Files that could run programs, read as data."""
