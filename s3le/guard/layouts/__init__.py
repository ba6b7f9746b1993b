"""Joint motions of any tool, read and written back in the layout that they came in."""
