"""From films to colored voxels (digitization paper, section 2)."""
