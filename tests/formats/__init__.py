"""Tests of the readers and writers of motion files."""
