"""Search for a clip as the pages and the report do: what is found beside the clip itself."""

from dataclasses import replace

from tasks.motion.importing import ImportSettings
from tasks.retrieval.answering import Answer, Tell, answer_query
from tasks.retrieval.searching import Match, SearchSettings
from viewer.holdings import FILE, Holdings, Motion


def find_others(
    holdings: Holdings,
    motion: Motion,
    clip: tuple[int, int],
    settings: SearchSettings,
    *,
    takes: str | None = None,
    imported: ImportSettings | None = None,
    tell: Tell | None = None,
) -> Answer:
    """Return what moves like a clip, without the clip itself, which is always the nearest.

    Its mirror image is no match of itself and stays.

    Parameters
    ----------
    motion, clip
        What to search with: the first and last frame of a motion.
    takes, imported, tell
        As of `answer_query`.

    Raises
    ------
    InputError, UnknownNameError, ArchiveError, ValueError
        As `answer_query`.
    """
    start, end = clip
    text = f"{motion.file or motion.name}:{start}-{end}"
    more = replace(settings, top=settings.top + 1)

    def is_other(match: Match) -> bool:
        return (
            match.mirrored
            or motion.version == FILE
            or match.take != motion.name
            or match.end < start
            or match.start > end
        )

    def tell_others(matches: list[Match], certain: int) -> None:
        if tell is not None:
            others = [match for match in matches if is_other(match)]
            tell(others, max(0, certain - (len(matches) - len(others))))

    answer = answer_query(holdings.location, text, more, takes, imported, tell_others)
    others = [match for match in answer.matches if is_other(match)]
    return replace(answer, settings=settings, matches=others[: settings.top])
