"""What is in the folder of a capture, by its name: the calibration, and the file of each camera."""

import os
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from storage.formats.calibration.reading import SUFFIXES as CALIBRATION_SUFFIXES
from storage.formats.pictures.video import PICTURE_SUFFIXES, VIDEO_SUFFIXES
from storage.formats.reading import listed

_PAIRS = ("intri.yml", "extri.yml", "cameras.txt", "images.txt")
FOLDERS = {
    "video": "videos",
    "background": "background",
    "mask": "silhouettes",
    "calibration": "calibration",
}
"""The folders that a capture may have, by what is in them."""
NOTHING_TELLS = (
    "nothing tells the performer from the stage: there is no folder `background` with pictures of "
    "the empty stage, and no folder `silhouettes` with masks; without either, write background = "
    '"film", or the key color of a screen, under [silhouettes] of digitize.toml'
)
"""What is said of a capture that has neither backgrounds nor masks."""


def unknown_folders(folder: Path) -> list[str]:
    """Return a note on the folders of a capture that nobody reads."""
    unknown = [
        path.name
        for path in sorted(folder.iterdir())
        if path.is_dir() and path.name not in FOLDERS.values() and not path.name.startswith(".")
    ]
    if not unknown:
        return []
    return [
        f"The capture has the folder {listed(unknown)}, which means nothing here: what is read are "
        f"{', '.join(FOLDERS.values())}."
    ]


def find_calibration(folder: Path, faults: list[str], notes: list[str]) -> Path | None:
    """Return the file or folder of the calibration."""
    named = sorted(folder.glob("calibration.*"))
    found = [path for path in named if path.suffix.lower() in CALIBRATION_SUFFIXES]
    found += [path for path in sorted(folder.glob("*.qca.txt")) if path.name[0] != "."]
    others = listed([path.name for path in named if path not in found])
    if (folder / "calibration").is_dir():
        found.append(folder / "calibration")
    found += [folder / name for name in _PAIRS if os.path.lexists(folder / name)][:1]
    found = list(dict.fromkeys(found))
    if len(found) == 1:
        if others:
            notes.append(f"{others} is no calibration that is read: left out.")
        return found[0]
    if found:
        names = listed([path.name for path in found])
        faults.append(f"there is more than one calibration: {names}; keep one")
    else:
        faults.append(
            "there is no calibration: put it there as calibration.toml (or .yml, .xml, .json, "
            ".txt, .qca.txt), intri.yml and extri.yml, cameras.txt and images.txt, or the folder "
            f"`calibration`{f' ({others} is none by its name)' if others else ''}"
        )
    return None


def find_telling(folder: Path, notes: list[str]) -> str:
    """Return what tells the performer from the stage: masks where there are any, or backgrounds."""
    masks, pictures = (folder / FOLDERS[what] for what in ("mask", "background"))
    if masks.is_dir() and pictures.is_dir():
        notes.append(
            f"The capture has masks in `{masks.name}` and pictures in `{pictures.name}`: the masks "
            "were taken."
        )
    return "mask" if masks.is_dir() else "background"


def files_of(what: str, folder: Path, faults: list[str]) -> dict[str, list[Path]] | None:
    """Return films, backgrounds or masks by their names, composed (NFC); None without a folder."""
    inside = folder / FOLDERS[what]
    if not inside.is_dir():
        if what == "video":
            faults.append(f"there is no folder `{inside.name}` with a {what} a camera")
        return None
    files: dict[str, list[Path]] = {}
    for path in sorted(inside.iterdir()):
        if path.name.startswith("."):
            continue
        is_video = path.suffix.lower() in VIDEO_SUFFIXES
        is_picture = path.suffix.lower() in PICTURE_SUFFIXES and what == "background"
        is_folder = path.is_dir() and what != "background"
        if is_folder or is_video or is_picture:
            # a Mac, or a share from one, writes a letter and its mark as two codes
            name = unicodedata.normalize("NFC", path.name if is_folder else path.stem)
            files.setdefault(name, []).append(path)
    return files


def unread_files(what: str, folder: Path, names: Sequence[str]) -> str:
    """Return, for a message, which files are called as cameras but are of no kind that is read."""
    inside = folder / FOLDERS[what]
    kinds = (*PICTURE_SUFFIXES, *VIDEO_SUFFIXES) if what == "background" else VIDEO_SUFFIXES
    unread = [
        path.name
        for path in sorted(inside.iterdir())
        if unicodedata.normalize("NFC", path.stem) in names and path.suffix.lower() not in kinds
    ]
    if not unread:
        return ""
    more = "" if what == "background" else ", or a folder of numbered pictures"
    return f"; {listed(unread)} is of no kind that is read ({', '.join(kinds)}{more})"
