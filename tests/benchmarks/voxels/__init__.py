"""Benchmarks of what is made of films: silhouettes, voxels and takes; cameras that are late."""
