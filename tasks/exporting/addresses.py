"""Addresses of the viewer's pages, for tables and pages that are read elsewhere."""

from urllib.parse import urlencode

from tasks.retrieval.answering import Answer


def clip_address(viewer: str, take: str, start: int, end: int) -> str:
    """Return where the viewer at `viewer` shows a clip, frames inclusive."""
    return _address(viewer, take=take, clip=f"{start}-{end}")


def match_address(viewer: str, answer: Answer, rank: int) -> str | None:
    """Return where the viewer shows a match beside its query; None where an address cannot say so.

    An address names a take of the archive and the usual settings; a file, other weights or other
    steps are of the search that was asked.
    """
    asked, settings = answer.query, answer.settings
    if "take" not in asked or settings.weights or settings.steps != "slope":
        return None
    said = {"take": asked["take"], "clip": f"{asked['start']}-{asked['end']}"}
    said |= {"part": settings.part, "top": str(settings.top)}
    if settings.threshold is not None:
        said["threshold"] = f"{settings.threshold:g}"
    if settings.mirror:
        said["mirror"] = "yes"
    if settings.path_weight:
        said["path"] = f"{settings.path_weight:g}"
    return _address(viewer, **said, match=str(rank), search="yes")


def _address(viewer: str, **said: str) -> str:
    return f"{viewer.rstrip('/')}/?{urlencode(said)}"
