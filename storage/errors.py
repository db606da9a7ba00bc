"""What can go wrong with an archive, or with a file that was brought to it."""


class InputError(ValueError):
    """A file or folder that a user brought cannot be used; the message says why and what to do."""


class ArchiveError(ValueError):
    """What stands in the archive does not fit what was asked of it."""


class UnknownNameError(ValueError):
    """A name that nothing has; the message gives the nearest names."""


class ConflictError(ArchiveError):
    """Somebody else published the same take in the meantime."""


class PlaceError(OSError):
    """The disk or object store behind an archive did not do what was asked: full, away, locked."""
