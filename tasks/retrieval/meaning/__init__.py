"""What a distance means: named levels, how often chance comes so near, and why a match is near."""
