"""Carving by boxes that are wholly inside or outside."""
