"""Which camera sees which voxel."""
