"""Joints as pose estimators and scenes give them: any layout, axes, unit; read, never executed."""
