"""Takes into files that other programs read."""
