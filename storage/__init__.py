"""Files: the only package that opens one."""

from storage.archive import Archive, Take, create_archive, open_archive

__all__ = ["Archive", "Take", "create_archive", "open_archive"]
