"""What the stages read of a capture: films and backgrounds."""
