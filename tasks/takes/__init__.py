"""Versions of takes, put together and published."""
