"""Look after an archive: whether everything is still as it was published."""

from storage import open_archive
from storage.arrays.search import verify_search_array
from storage.publication import published_takes, read_record, verify_take


def verify_archive(archive: str) -> tuple[int, list[str]]:
    """Recompute the digests of all takes; return how many there are, and each fault."""
    place = open_archive(archive).place
    takes = published_takes(place)
    faults: list[str] = []
    for take in takes:
        faults += (found := verify_take(place, take))
        record = None if found else read_record(place, take)
        if record and "motion" in record.stages:
            faults += verify_search_array(place, take, record.version)
    return len(takes), faults
