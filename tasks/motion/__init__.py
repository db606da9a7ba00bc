"""Motion files into joint tracks."""
