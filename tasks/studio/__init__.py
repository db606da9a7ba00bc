"""Generated performances, whose truth is known, and films of them."""
