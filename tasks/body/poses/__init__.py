"""The poses of a whole take, by either method."""
