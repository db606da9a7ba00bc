"""Benchmarks of poses, labels and doubt, on captures of known truth."""
