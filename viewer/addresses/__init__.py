"""The addresses from which pages, and other programs, get frames, pictures and files."""
