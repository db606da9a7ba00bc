"""A segment for every voxel of a frame."""
