"""Outlines, connected components and pixels of silhouettes."""
