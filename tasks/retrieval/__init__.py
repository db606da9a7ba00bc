"""Comparing motions: normalization, paths and warping; pure functions over arrays."""
