"""The joints that a take begins with, read off a hull's shape."""
