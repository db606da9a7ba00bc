"""How likely each segment of each frame is in the wrong place, from evidence that the fit left."""
