"""The nearest of many stored vectors: exactly, or by a graph."""
