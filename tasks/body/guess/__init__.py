"""A body of usual proportions, for takes in which nobody stretches the arms."""
