"""Benchmarks of what surrounds the work: Prefect, reading, the archive, the viewer."""
