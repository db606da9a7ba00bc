"""Capture folders: their settings, films, backgrounds and initial model."""
