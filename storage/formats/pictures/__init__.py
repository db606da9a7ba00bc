"""Pictures, films and point clouds, read and written."""
