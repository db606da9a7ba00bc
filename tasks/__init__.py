"""Arithmetic: one stage, one module."""
