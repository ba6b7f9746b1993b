"""The command line: thin, and quick to say what it can do; the work is done in the library."""
