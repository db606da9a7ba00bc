"""A search that skips doubtful frames finds what one does in a motion without them."""

import shutil

import numpy as np
import pytest

from storage import create_archive, open_archive
from tasks.motion.stature import joints_present
from tasks.retrieval.answering import answer_query
from tasks.retrieval.indexing import index_take
from tasks.retrieval.normalization import pack_motion
from tasks.retrieval.searching import SearchSettings, clip_take, search_takes
from tasks.retrieval.segments import PackedTake
from tests.figures.archives.digitized_takes import FRAMES, RATE_HZ, STATURE_M, write_digitized

DOUBTFUL = {"danced": (6, 7), "sure": ()}
SKIP = SearchSettings(skip_doubtful=True, top=50)


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Two takes that are alike; of one, two frames are doubtful."""
    opened = create_archive(tmp_path_factory.mktemp("skipping") / "archive")
    for name, doubtful in DOUBTFUL.items():
        record = write_digitized(opened.place, name, doubtful=doubtful)
        index_take(opened.location, name, record.version)
    return opened.location


def test_no_match_is_in_doubtful_frames_and_all_others_are_found(archive):
    position = open_archive(archive).take("danced").motion["position"].values
    takes = {}
    for name, doubtful in DOUBTFUL.items():
        left = position.copy()
        left[list(doubtful)] = np.nan
        rows = pack_motion(left, RATE_HZ, STATURE_M)
        takes[name] = PackedTake(name, rows, RATE_HZ, FRAMES, joints_present(position))
    expected = search_takes(clip_take(takes["sure"], 0, 3), takes.values(), SKIP)
    found = answer_query(archive, "danced:0-3", SKIP)
    assert found.matches == expected.matches
    assert {match.take for match in found.matches} == {"danced", "sure"}
    own = [match for match in found.matches if match.take == "danced"]
    assert all(match.end < 6 or match.start > 7 for match in own)
    every = answer_query(archive, "danced:0-3", SearchSettings(top=50)).matches
    assert any(m.take == "danced" and m.start <= 7 and m.end >= 6 for m in every)
    assert [m for m in every if m.take == "sure"] == [m for m in found.matches if m.take == "sure"]


def test_a_take_whose_pose_is_damaged_is_said_and_not_searched(archive, tmp_path):
    copy = shutil.copytree(archive, tmp_path / "copy")
    [chunk] = (copy / "takes" / "danced").glob("**/pose/doubtful/c/0")
    chunk.write_bytes(b"damaged")
    found = answer_query(str(copy), "sure:0-3", SKIP)
    assert "danced" in found.skipped
    assert {match.take for match in found.matches} == {"sure"}
