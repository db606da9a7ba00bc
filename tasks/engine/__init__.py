"""Kernels, threads, and names for the same computation."""
