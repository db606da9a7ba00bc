"""Cameras calibrated from films or pictures of a board."""
