"""The data dictionary: one file per Parquet table, each stating grain, key, units and rules."""
