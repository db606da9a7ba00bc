"""The clip of a match and the path onto it are those of the archive and of the search."""

import json

import numpy as np
import pytest

from storage import open_archive
from storage.errors import InputError, UnknownNameError
from storage.schema import JOINTS
from tasks.retrieval.answering import find_matches
from tasks.retrieval.clips import read_clip, read_path
from tests.figures.archives.dances import RATE_HZ, make_dances


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The generated dances at 30 Hz, and their positions by name."""
    location = tmp_path_factory.mktemp("clips") / "archive"
    return location, make_dances(location)


def test_the_clip_of_a_match_is_that_part_of_the_take(archive):
    location, positions = archive
    table = find_matches(location, "asked:60-119", part="feet", top=4)
    assert len(table) == 4
    for _, row in table.iterrows():
        clip = read_clip(location, row)
        start, end = row["start"], row["end"]
        assert clip.dims == ("time", "joint", "space")
        np.testing.assert_array_equal(clip.values, positions[row["take"]][start : end + 1])
        np.testing.assert_array_equal(clip["frame"].values, np.arange(start, end + 1))
        np.testing.assert_allclose(clip["time"].values, np.arange(start, end + 1) / RATE_HZ)
        assert list(clip["joint"].values) == list(JOINTS)
        assert clip.attrs["take"] == row["take"]
        assert clip.attrs["mirrored"] is False


@pytest.mark.parametrize(
    "options", [{"weights": {"Head": 2.0}}, {"mirror": True, "part": "arms"}, {"path_weight": 0.2}]
)
def test_the_path_leads_from_end_to_end_and_has_the_distance_of_the_match(archive, options):
    location, _ = archive
    table = find_matches(open_archive(location), "asked:60-119", takes="answer", top=3, **options)
    assert json.loads(json.dumps(table.attrs)) == table.attrs  # as files of tables keep them
    for row in table.index:
        path, match = read_path(location, table, row), table.loc[row]
        assert tuple(path.iloc[0][["query", "match"]]) == (60, match["start"])
        assert tuple(path.iloc[-1][["query", "match"]]) == (119, match["end"])
        moves = np.diff(path[["query", "match"]].to_numpy(), axis=0)
        assert set(map(tuple, moves)) <= {(1, 1), (1, 0), (0, 1)}
        # 1-2-1: a step of both counts twice, and of the first pair once
        weights = np.concatenate([[1], moves.sum(axis=1)])
        # the step off the diagonal and the one before share their three: 2 then 1
        total = (weights * path["distance"]).sum() / weights.sum()
        assert total == pytest.approx(match["distance"], rel=1e-4)


def test_a_match_that_is_not_there_is_said(archive, tmp_path):
    location, _ = archive
    table = find_matches(location, "asked:60-119", top=2)
    with pytest.raises(UnknownNameError, match=r"no take 'askd'.*asked"):
        read_clip(location, {"take": "askd", "start": 0, "end": 3})
    with pytest.raises(ValueError, match="take 'asked' has the frames 0-239, and not 230-240"):
        read_clip(location, {"take": "asked", "start": 230, "end": 240})
    with pytest.raises(ValueError, match="a match has take, start and end, and this has no 'end'"):
        read_clip(location, {"take": "asked", "start": 230})
    with pytest.raises(InputError, match="is not an archive"):
        read_clip(tmp_path, table.loc[0])
    with pytest.raises(KeyError):
        read_path(location, table, 2)
    other = table.copy()
    other.attrs.clear()
    with pytest.raises(ValueError, match="does not say what was searched for"):
        read_path(location, other)
    paper = find_matches(location, "asked:60-119", top=1, steps="paper")
    with pytest.raises(ValueError, match="of the steps 'slope' and not of 'paper'"):
        read_path(location, paper)
