"""What a take's Zarr groups hold, and how it is written and read."""
