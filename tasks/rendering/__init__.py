"""Pictures of voxels, joints and searches."""
