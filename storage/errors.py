"""What can be wrong with an archive, or with a file that was brought to it."""


class InputError(ValueError):
    """A file or folder that a user brought cannot be used; the message says why and what to do."""


class ArchiveError(ValueError):
    """Something asked of the archive does not fit what it holds."""
