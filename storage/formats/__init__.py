"""Readers and writers of the files that users bring."""
