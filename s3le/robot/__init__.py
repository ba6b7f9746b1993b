"""Robot descriptions, URDF geometry and the coal check: the only door to pinocchio and coal."""
