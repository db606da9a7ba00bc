"""Rotations, skeletons and the floor: pure functions over arrays."""
