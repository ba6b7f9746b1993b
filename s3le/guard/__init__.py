"""Any joint motion in, the nearest certified motion out."""
