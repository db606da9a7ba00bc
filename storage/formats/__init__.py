"""Readers and writers of the files that users bring.

A file is brought and written by its suffix: `read_motion_file` asks the module of that format,
and imports it only then.
"""

from pathlib import Path

from storage.errors import InputError
from storage.formats.motion.motion_file import MotionFile

MOTION_SUFFIXES = (".c3d", ".trc", ".bvh")
"""The suffixes of the files that `read_motion_file` accepts, in lower case."""


def read_motion_file(path: Path) -> MotionFile:
    """Read the markers or bones of a motion file, whose suffix says what it is.

    Parameters
    ----------
    path : Path
        A C3D, TRC or BVH file; the case of the suffix does not matter.

    Returns
    -------
    MotionFile
        As the file has it: in its own unit, axes and names.

    Raises
    ------
    InputError
        The file is not one of these, or cannot be read rightly; the message says why.
    """
    path = Path(path)
    match path.suffix.lower():
        case ".c3d":
            from storage.formats.motion.c3d import read_c3d as read
        case ".trc":
            from storage.formats.motion.trc import read_trc as read
        case ".bvh":
            from storage.formats.motion.bvh import read_bvh as read
        case _:
            raise InputError(
                f"{path} is not a motion file that can be read: bring a file whose name ends "
                f"in {', '.join(MOTION_SUFFIXES[:-1])} or {MOTION_SUFFIXES[-1]}"
            )
    return read(path)
