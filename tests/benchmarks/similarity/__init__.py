"""Benchmarks of the search and its index."""
