"""Search for a clip as the pages and the report do: what is found beside the clip itself."""

from dataclasses import replace

from tasks.motion.importing import ImportSettings
from tasks.retrieval.answering import Answer, answer_query
from tasks.retrieval.searching import SearchSettings
from viewer.holdings import FILE, Holdings, Motion


def find_others(
    holdings: Holdings,
    motion: Motion,
    clip: tuple[int, int],
    settings: SearchSettings,
    *,
    takes: str | None = None,
    imported: ImportSettings | None = None,
) -> Answer:
    """Return what moves like a clip, without the clip itself, which is always the nearest.

    Its mirror image is no match of itself and stays.

    Parameters
    ----------
    motion, clip
        What to search with: the first and last frame of a motion.
    takes, imported
        As of `answer_query`.

    Raises
    ------
    InputError, UnknownNameError, ArchiveError, ValueError
        As `answer_query`.
    """
    start, end = clip
    text = f"{motion.file or motion.name}:{start}-{end}"
    more = replace(settings, top=settings.top + 1)
    answer = answer_query(holdings.location, text, more, takes, imported)
    others = [
        match
        for match in answer.matches
        if match.mirrored
        or motion.version == FILE
        or match.take != motion.name
        or match.end < start
        or match.start > end
    ]
    return replace(answer, settings=settings, matches=others[: settings.top])
