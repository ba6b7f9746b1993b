"""S3LE: human motion to humanoid motion, every returned pose certified feasible.

Deliberately empty: importing a room costs that room alone, and DVC sees only what a stage uses.
"""
