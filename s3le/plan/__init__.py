"""Wanted joint positions over time to the nearest certified motion: whole files, and streams."""
