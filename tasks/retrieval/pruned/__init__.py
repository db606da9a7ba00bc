"""Which parts of segments a match can be in, and the matches there: bounds before kernels."""
