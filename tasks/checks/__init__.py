"""Whether a capture, or a layout of cameras, can be digitized."""
