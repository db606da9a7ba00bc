"""From colored voxels to a moving, segmented body (digitization paper, section 3)."""
