import numpy as np
import pytest

from storage.schema import JOINTS
from tasks.motion.stature import joints_present
from tasks.retrieval.meaning.explaining import explain_match, samples_of_match
from tasks.retrieval.normalization import (
    OTHER_SIDE,
    frame_of_sample,
    pack_motion,
    sample_count,
)
from tasks.retrieval.searching import Query, SearchSettings, search_takes
from tasks.retrieval.segments import PackedTake
from tests.conftest import swaying_body


def packed(seed, frames, rate_hz=30.0):
    position = swaying_body(seed, frames).astype(np.float32)
    rows = pack_motion(position, rate_hz, 1.6)
    return PackedTake(f"take{seed}", rows, rate_hz, frames, joints_present(position))


def best_of_all_paths(apart):
    """The least of the weighted sums over all paths, found by trying every one of them."""
    rows, columns = apart.shape

    def best(i, j):
        if i == 0:
            return apart[0, 0] if j == 0 else np.inf
        found = [np.inf]
        if j >= 1:
            found.append(best(i - 1, j - 1) + 2 * apart[i, j])
        if j >= 2:
            found.append(best(i - 1, j - 2) + 2 * apart[i, j - 1] + apart[i, j])
        if i >= 2 and j >= 1:
            found.append(best(i - 2, j - 1) + 2 * apart[i - 1, j] + apart[i, j])
        return min(found)

    return best(rows - 1, columns - 1) / (rows + columns - 1)


@pytest.mark.parametrize(
    "settings",
    [
        SearchSettings(top=3),
        SearchSettings(part="feet", top=3),
        SearchSettings(part="right-arm", top=3),
        SearchSettings(part="legs", weights=(("RKnee", 0.3),), path_weight=0.4, top=3),
        SearchSettings(part="arms", mirror=True, top=4),
    ],
    ids=["whole", "feet", "about-the-shoulders", "weights-and-path", "mirrored"],
)
def test_the_path_found_again_has_the_distance_that_the_search_told(settings):
    asked, take = packed(1, 40), packed(2, 150)
    query = Query(asked.rows[:, 5:30], asked.joints_present)
    matches = search_takes(query, [take], settings, threads=1).matches
    assert len(matches) >= 3
    for match in matches:
        own = query.joints_present[OTHER_SIDE] if match.mirrored else query.joints_present
        clip = take.rows[:, match.start : match.end + 1]
        found = explain_match(
            query.rows, clip, own & take.joints_present, settings, mirrored=match.mirrored
        )
        assert found.total == pytest.approx(match.distance, rel=1e-5)
        assert found.pairs[0].tolist() == [0, 0]
        assert found.pairs[-1].tolist() == [24, match.end - match.start]
        assert (np.diff(found.pairs, axis=0) >= 0).all()
        if not settings.path_weight:
            told = np.nansum(found.by_joint * found.weights)
            assert told == pytest.approx(found.distance.mean())


def test_no_other_path_is_shorter():
    rng = np.random.default_rng(5)
    query, match = (rng.random((69, n)).astype(np.float32) for n in (6, 8))
    joints = np.ones(len(JOINTS), bool)
    found = explain_match(query, match, joints, SearchSettings(part="head"))
    middle = slice(63, 66)
    apart = np.zeros((6, 8))
    for row in (0, 3):  # Head and Neck, from the shoulders
        a, b = query[row : row + 3] - query[middle], match[row : row + 3] - match[middle]
        apart += np.linalg.norm(a[:, :, None] - b[:, None], axis=0) / 2
    assert found.total == pytest.approx(best_of_all_paths(apart), rel=1e-6)


def test_clips_that_cannot_be_warped_are_refused():
    take = packed(1, 40)
    joints = take.joints_present
    with pytest.raises(ValueError, match="no path leads"):
        explain_match(take.rows[:, :30], take.rows[:, :5], joints, SearchSettings())
    with pytest.raises(ValueError, match="no joint with weight in common"):
        explain_match(take.rows, take.rows, ~joints, SearchSettings())


@pytest.mark.parametrize("rate_hz", [24.0, 25.0, 29.97, 60.0, 120.0])
def test_the_samples_of_a_match_are_those_that_have_its_frames(rate_hz):
    frames = 200
    count = sample_count(frames, rate_hz)
    for first in range(0, count - 20, 7):
        last = min(first + 19, count - 1)
        start = frame_of_sample(first, rate_hz)
        end = min(frame_of_sample(last, rate_hz), frames - 1)
        starts, ends = samples_of_match(start, end, rate_hz, frames)
        assert first in starts
        assert last in ends
