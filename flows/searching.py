"""A search of the whole archive, as a run on the dashboard."""

import logging

from prefect import flow, task
from prefect.cache_policies import NO_CACHE

from flows.dashboard import show_matches
from tasks.motion.importing import ImportSettings
from tasks.retrieval.answering import Answer, answer_query
from tasks.retrieval.searching import Match, SearchSettings

logger = logging.getLogger(__name__)


@flow(name="search_archive", flow_run_name="search {archive} for {query}")
def search_archive(
    archive: str,
    query: str,
    settings: SearchSettings | None = None,
    takes: str | None = None,
    imported: ImportSettings | None = None,
) -> Answer:
    """Find what moves like `query` (TAKE[:START-END] or FILE[:START-END]) in all takes."""
    answer = search_now(archive, query, settings or SearchSettings(), takes, imported)
    show_matches(archive, query, answer)
    return answer


@task(name="search", task_run_name="search for {query}", cache_policy=NO_CACHE)
def search_now(
    archive: str,
    query: str,
    settings: SearchSettings,
    takes: str | None,
    imported: ImportSettings | None,
) -> Answer:
    """Search; kept out of the cache, because every new take may change the answer."""

    def tell(matches: list[Match], certain: int) -> None:
        logger.info("%d matches so far, %d of them certain", len(matches), certain)

    return answer_query(archive, query, settings, takes, imported, tell)
