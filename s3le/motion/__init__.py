"""Motions of a robot as files: Parquet, CSV and NPZ, written here or by other tools."""
