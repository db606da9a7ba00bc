"""What a body is: segments, bones, shape, proportions, skin."""
