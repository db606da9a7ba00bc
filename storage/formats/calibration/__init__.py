"""Calibration files of other programs into cameras."""
