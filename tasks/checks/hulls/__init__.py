"""What the hulls of silhouettes say of these: the room they take, and who contradicts whom."""
