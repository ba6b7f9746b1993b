"""Feasible data (x~, x-bar, q~, q-bar): from mocap by inverse kinematics, and from the robot."""
