"""Batched kinematics, distances and projection in torch: the kernels' counterpart for GPUs."""
