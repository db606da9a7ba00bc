"""What several wings share: voxels, lines of voxels, projection, sides of a grid, runs."""
