"""Outlines, specks and pixels of silhouettes."""
