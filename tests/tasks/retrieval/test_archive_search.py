"""A search by the workers of a cluster answers what one in this process does, to the last bit."""

import shutil
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import pytest

from storage import open_archive
from storage.errors import ArchiveError
from storage.formats.motion.trc import write_trc
from storage.index.segments import FOLDER
from storage.schema import JOINTS
from tasks.retrieval import archive_search, gathering
from tasks.retrieval.answering import answer_query, find_query
from tasks.retrieval.archive_search import Cluster, search_archive
from tasks.retrieval.gathering import gather_segments
from tasks.retrieval.searching import SearchSettings
from tests.conftest import swaying_body
from tests.figures.archives.imported import take_in_plainly

pytestmark = pytest.mark.compiled

SEEDS = {"f": 1, "e": 2, "d": 1, "c": 3, "b": 1, "a": 4, "beside": 1}
"""Takes of one seed move alike, so that their distances are equal."""


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Takes in segments of two, the last one beside them."""
    folder = tmp_path_factory.mktemp("spread")
    location = str(folder / "archive")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gathering, "SEGMENT", 200)
        for name, seed in SEEDS.items():
            walk = folder / f"{name}.trc"
            write_trc(walk, swaying_body(seed, 90), JOINTS, 30.0)
            take_in_plainly(location, walk)
            if name != "beside":
                gather_segments(location)
    assert len(open_archive(location).listing().snapshot.labels) >= 3
    return location


def spread(workers, at_once=2):
    return Cluster(workers, at_once)


@pytest.fixture(scope="module")
def cluster():
    with ThreadPoolExecutor(2) as workers:
        yield spread(workers)


@pytest.mark.parametrize("top", [1, 2, 3, 50])
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"part": "feet"},
        {"mirror": True, "path_weight": 0.2},
        {"threshold": 0.05},
        {"steps": "paper"},
        {"takes": "[abc]*"},
    ],
    ids=str,
)
@pytest.mark.parametrize("at_once", [1, 3])
def test_the_answer_is_that_of_one_process(archive, settings, top, at_once):
    settings = dict(settings)
    takes = settings.pop("takes", None)
    asked = archive, "d:20-50", SearchSettings(top=top, **settings), takes
    expected = answer_query(*asked)
    with ThreadPoolExecutor(at_once) as workers:
        found = answer_query(*asked, cluster=spread(workers, at_once))
    assert found.matches == expected.matches
    assert found.skipped == expected.skipped
    assert len(found.matches) == top or top == 50 or "threshold" in settings


def test_equal_distances_come_in_the_order_of_takes_wherever_they_lie(archive, cluster):
    found = answer_query(archive, "d:20-50", SearchSettings(top=2), cluster=cluster).matches
    assert [match.take for match in found] == ["b", "beside"]
    assert found[0].distance == found[1].distance


class OneByOne(Executor):
    """Does each call when it is asked for, and keeps what distance it was given."""

    def __init__(self):
        self.thresholds = []

    def submit(self, function, /, *given):
        self.thresholds.append(given[-1].threshold)
        done = Future()
        try:
            done.set_result(function(*given))
        except Exception as error:
            done.set_exception(error)
        return done


def test_workers_that_begin_later_are_given_a_smaller_distance(archive):
    workers = OneByOne()
    answer_query(archive, "d:20-50", SearchSettings(top=1), cluster=spread(workers, 1))
    first, *later = workers.thresholds
    assert first is None
    assert later
    assert all(each is not None for each in later)
    assert later == sorted(later, reverse=True)


def test_what_is_damaged_is_not_answered_from_and_is_said(archive, cluster, tmp_path):
    copy = shutil.copytree(archive, tmp_path / "copy", symlinks=True)
    for rows in copy.glob(f"{FOLDER}/*.rows.npy"):
        content = bytearray(rows.read_bytes())
        content[-len(content) // 4] ^= 0xFF
        rows.write_bytes(content)
    settings = SearchSettings(top=50)
    expected = answer_query(str(copy), "beside:20-50", settings)
    found = answer_query(str(copy), "beside:20-50", settings, cluster=cluster)
    assert found.matches == expected.matches
    assert found.skipped == expected.skipped
    assert found.skipped


def test_takes_whose_segment_a_worker_cannot_read_are_read_one_by_one(
    archive, cluster, monkeypatch
):
    expected = answer_query(archive, "d:20-50", SearchSettings(top=50))

    def gone(_place, path, _sha256):
        raise archive_search.DamagedSegmentError("it is gone", path)

    monkeypatch.setattr(archive_search, "read_label", gone)
    found = answer_query(archive, "d:20-50", SearchSettings(top=50), cluster=cluster)
    assert found.matches == expected.matches
    assert found.skipped == {}


def test_a_worker_that_does_not_see_the_archive_says_so(archive, monkeypatch):
    search = archive_search.search_label

    def elsewhere(_location, *given):
        return search("/nowhere/archive", *given)

    monkeypatch.setattr(archive_search, "search_label", elsewhere)
    with pytest.raises(ArchiveError, match=r"a worker does not see the archive: .*/nowhere"):
        answer_query(archive, "d:20-50", SearchSettings(), cluster=spread(OneByOne()))


def test_a_search_that_is_stopped_asks_nothing_more_of_the_workers(archive):
    class StopError(Exception):
        pass

    def stop(_matches, _certain):
        raise StopError

    workers = OneByOne()
    with pytest.raises(StopError):
        answer_query(archive, "d:20-50", SearchSettings(), tell=stop, cluster=spread(workers, 1))
    assert len(workers.thresholds) == 1


@pytest.mark.slow
def test_other_processes_answer_the_same(archive):
    settings = SearchSettings(top=5, mirror=True)
    expected = answer_query(archive, "d:20-50", settings)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as workers:
        found = answer_query(archive, "d:20-50", settings, cluster=spread(workers))
    assert found.matches == expected.matches


def test_no_take_is_searched_twice_whatever_the_labels_say(archive, cluster):
    opened = open_archive(archive)
    listing = opened.listing()
    query, _ = find_query(opened, listing, "d:20-50", None)
    snapshot = listing.snapshot
    twice = replace(snapshot, labels=snapshot.labels * 2, digests=snapshot.digests * 2)
    asked = listing.entries, query, SearchSettings(top=50)
    expected = search_archive(opened.place, listing, *asked)
    doubled = replace(listing, snapshot=twice)
    found = search_archive(opened.place, doubled, *asked, cluster=cluster)
    assert found.matches == expected.matches
