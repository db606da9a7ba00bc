"""What can go wrong with an archive, or with a file that was brought to it."""


class InputError(ValueError):
    """A file or folder that a user brought cannot be used; the message says why and what to do."""


class ArchiveError(ValueError):
    """What stands in the archive does not fit what was asked of it."""


class UnknownNameError(ValueError):
    """A name that nothing has; the message gives the nearest names."""


class ConflictError(ArchiveError):
    """Somebody else published the same take in the meantime."""


class DamagedSegmentError(ArchiveError):
    """A file of a segment of the index is not what was written.

    Parameters
    ----------
    label
        The path of the segment's label.
    summary
        The name of the summary that is at fault; None where it is the rows or the label.
    """

    def __init__(self, said: str, label: str, summary: str | None = None) -> None:
        super().__init__(said)
        self.label, self.summary = label, summary


class PlaceError(OSError):
    """The disk or object store behind an archive did not do what was asked: full, away, locked."""
