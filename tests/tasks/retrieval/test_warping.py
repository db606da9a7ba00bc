import numpy as np
import pytest

from tasks.retrieval import warping
from tasks.retrieval.warping import select_matches, shortest_match, warm_up, warp, warp_spans
from tests.twins import search as naive

ROWS = 69


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    """Let interpreted code meet the borders of tiles; compiled code keeps its own size."""
    monkeypatch.setattr(warping, "_TILE", 64)


def clip_of(query, columns=None, weights=None):
    """Return (frame, joint, 3) positions as a clip whose joints are the first of the rows."""
    joints = query.shape[1]
    weights = np.full(joints, 1 / joints) if weights is None else np.array(weights)
    if columns is None:
        columns = np.stack([np.arange(3 * joints), np.full(3 * joints, -1)], axis=1)
    flat = np.ascontiguousarray(query.reshape(len(query), -1), np.float32)
    return flat, weights.astype(np.float32), np.asarray(columns, np.int64)


def rows_of(take):
    """Return (frame, joint, 3) positions as packed rows, the others filled with 9."""
    rows = np.full((ROWS, len(take)), 9, np.float32)
    rows[: 3 * take.shape[1]] = take.reshape(len(take), -1).T
    return rows


def run(clip, rows, steps="slope", span=None):
    distance = np.full(rows.shape[1], -1, np.float32)
    start = np.full(rows.shape[1], -1, np.int32)
    warp(clip, rows, span or (0, 0, rows.shape[1]), distance, start, steps=steps)
    return distance, start


def line(*values):
    """Return positions of one joint on the x axis."""
    return np.array([[[value, 0, 0]] for value in values], float)


def assert_same_ends(found, expected):
    np.testing.assert_allclose(found[0], expected[0], rtol=2e-6)
    ends = np.isfinite(expected[0])
    np.testing.assert_array_equal(found[1][ends], expected[1][ends])


def test_the_papers_steps_are_worked_out():
    # d(1, .) = 1 0 2 2, d(2, .) = 1 2 0 0; g(2, .) = 2 2 0 0 with starts 1 2 2 2 of the paper
    distance, start = run(clip_of(line(0, 2)), rows_of(line(1, 0, 2, 2)), "paper")
    assert distance.tolist() == [1.0, 1.0, 0.0, 0.0]
    assert start.tolist() == [0, 1, 1, 1]


def test_the_slope_steps_are_worked_out():
    # d: 0 2 1 3 / 1 1 0 2 / 3 1 2 0; g(3, .) = inf 3 4 2 with starts - 1 2 2, counted from 1
    distance, start = run(clip_of(line(0, 1, 3)), rows_of(line(0, 2, 1, 3)))
    np.testing.assert_allclose(distance, [np.inf, 3 / 4, 4 / 4, 2 / 5])
    assert start[1:].tolist() == [0, 1, 1]


@pytest.mark.parametrize("steps", ["slope", "paper"])
@pytest.mark.parametrize("frames", [1, 2, 3, 9])
def test_warping_agrees_with_its_naive_twin_where_many_are_equal(rng, steps, frames):
    query = line(*rng.integers(0, 4, frames))
    take = line(*rng.integers(0, 4, 150))
    found = run(clip_of(query), rows_of(take), steps)
    expected = naive.ends(naive.distances(query, take, [1]), steps)
    assert_same_ends(found, expected)
    assert frames == 1 or len(set(np.arange(150) - found[1])) > 2


@pytest.mark.parametrize("steps", ["slope", "paper"])
@pytest.mark.parametrize("joints", [1, 2, 3, 4, 5, 7])
def test_warping_agrees_with_its_naive_twin_for_any_number_of_joints(rng, steps, joints):
    query, take = rng.normal(size=(6, joints, 3)), rng.normal(size=(67, joints, 3))
    weights = rng.random(joints) + 0.1
    weights /= weights.sum()
    found = run(clip_of(query, weights=weights), rows_of(take), steps)
    expected = naive.ends(naive.distances(query, take, weights), steps)
    assert_same_ends(found, expected)


@pytest.mark.compiled
@pytest.mark.parametrize("steps", ["slope", "paper"])
@pytest.mark.parametrize("samples", [511, 512, 513, 1300])
def test_warping_agrees_with_its_naive_twin_over_many_tiles(rng, steps, samples):
    query, take = line(*rng.integers(0, 9, 7)), line(*rng.integers(0, 9, samples))
    expected = naive.ends(naive.distances(query, take, [1]), steps)
    assert_same_ends(run(clip_of(query), rows_of(take), steps), expected)


def test_rows_are_taken_where_the_columns_say_less_their_origin(rng):
    rows = rng.normal(size=(ROWS, 40)).astype(np.float32)
    columns = [[12, 63], [13, 64], [14, 65], [66, -1], [67, -1], [68, -1]]
    query = rng.normal(size=(5, 2, 3))
    take = np.stack([rows[12:15] - rows[63:66], rows[66:69]]).transpose(2, 0, 1)
    expected = naive.ends(naive.distances(query, take, [0.5, 0.5]), "slope")
    assert_same_ends(run(clip_of(query, columns), rows), expected)


@pytest.mark.parametrize("steps", ["slope", "paper"])
def test_a_missing_frame_is_never_part_of_a_match(rng, steps):
    query, take = rng.normal(size=(5, 2, 3)), rng.normal(size=(90, 2, 3))
    lost = [0, 31, 63, 64, 80]
    take[lost, 1, 2] = np.nan
    distance, start = run(clip_of(query), rows_of(take), steps)
    expected = naive.ends(naive.distances(query, take, [0.5, 0.5]), steps)
    assert_same_ends((distance, start), expected)
    ended = np.flatnonzero(np.isfinite(distance))
    assert len(ended) > 40
    assert not any(start[j] <= k <= j for j in ended for k in lost)


def test_a_missing_joint_of_tiny_weight_is_missing_all_the_same(rng):
    query, take = rng.normal(size=(5, 2, 3)), rng.normal(size=(20, 2, 3))
    take[10, 1] = np.nan
    distance, _ = run(clip_of(query, weights=[1, 1e-12]), rows_of(take))
    assert np.isinf(distance[10])


@pytest.mark.compiled
def test_numbers_too_large_to_square_are_infinitely_far(rng):
    query, take = rng.normal(size=(3, 1, 3)), rng.normal(size=(20, 1, 3))
    take[8] = 1e30
    distance, _ = run(clip_of(query), rows_of(take))
    assert np.flatnonzero(np.isinf(distance)).tolist() == [0, 8, 9]


def test_a_clip_finds_itself_at_distance_zero(rng):
    rows = rng.normal(size=(ROWS, 130)).astype(np.float32)
    columns = np.stack([np.arange(63), np.tile([63, 64, 65], 21)], axis=1)
    frames = (rows[:63] - rows[columns[:, 1]])[:, 55:80].T
    clip = np.ascontiguousarray(frames), np.full(21, 1 / 21, np.float32), columns
    distance, start = run(clip, rows)
    assert (distance[79], start[79]) == (0.0, 55)
    assert (np.delete(distance, 79) > 0).all()


def test_matches_are_between_half_and_twice_the_query(rng):
    query, take = rng.integers(0, 3, 9), rng.integers(0, 3, 400)
    distance, start = run(clip_of(line(*query)), rows_of(line(*take)))
    length = (np.arange(400) - start + 1)[np.isfinite(distance)]
    assert shortest_match(9, "slope") == 5 == length.min()
    assert length.max() <= warm_up(9) + 1 == 17


@pytest.mark.parametrize("frames", range(1, 8))
def test_the_shortest_match_fits_and_a_shorter_take_holds_none(frames):
    shortest = shortest_match(frames, "slope")
    clip = clip_of(line(*range(frames)))
    assert np.isfinite(run(clip, rows_of(line(*[0] * shortest)))[0][-1])
    if shortest > 1:
        assert np.isinf(run(clip, rows_of(line(*[0] * (shortest - 1))))[0]).all()


def test_the_longest_match_starts_where_warming_up_does():
    query = line(0, 1, 2, 3)
    take = line(5, 0, 1, 1, 2, 2, 3, 3, 5)
    assert warm_up(4) == 6
    distance, start = run(clip_of(query), rows_of(take), span=(1, 7, 9))
    assert (distance[7], start[7]) == (0.0, 1)
    assert distance[:7].tolist() == [-1] * 7


@pytest.mark.parametrize("cut", [1, 20, 63, 64, 65, 100])
def test_pieces_give_what_the_whole_gives(rng, cut):
    rows = rows_of(rng.integers(0, 4, size=(150, 2, 3)))
    clip = clip_of(rng.integers(0, 4, size=(9, 2, 3)))
    distance, start = run(clip, rows)
    for first, last in ((0, cut), (cut, 150)):
        piece = run(clip, rows, span=(max(0, first - warm_up(9)), first, last))
        np.testing.assert_array_equal(piece[0][first:last], distance[first:last])
        ends = first + np.flatnonzero(np.isfinite(distance[first:last]))
        np.testing.assert_array_equal(piece[1][ends], start[ends])
        assert (np.delete(piece[0], np.s_[first:last]) == -1).all()


@pytest.mark.compiled
def test_pieces_give_what_the_whole_gives_to_the_last_bit(rng):
    rows = rng.normal(size=(ROWS, 5000)).astype(np.float32)
    clip = clip_of(rng.normal(size=(170, 20, 3)))
    distance, start = run(clip, rows)
    for first, last in ((0, 1777), (1777, 3511), (3511, 5000)):
        piece = run(clip, rows, span=(max(0, first - warm_up(170)), first, last))
        ends = first + np.flatnonzero(np.isfinite(distance[first:last]))
        np.testing.assert_array_equal(piece[0][ends], distance[ends])
        np.testing.assert_array_equal(piece[1][ends], start[ends])


@pytest.mark.compiled
def test_a_take_mapped_into_memory_is_compiled_no_second_time(rng, tmp_path):
    rows = rows_of(rng.normal(size=(70, 2, 3)))
    np.save(tmp_path / "rows.npy", rows)
    clip = clip_of(rng.normal(size=(5, 2, 3)))
    distance, start = run(clip, rows)
    mapped = run(clip, np.load(tmp_path / "rows.npy", mmap_mode="r"))
    np.testing.assert_array_equal(mapped, (distance, start))
    assert len(warping._warp.signatures) == 1


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 24.0, 18.0, 45.0])
@pytest.mark.parametrize("versions", [1, 2])
def test_selection_agrees_with_its_naive_twin(rng, rate_hz, versions):
    distance = rng.integers(0, 40, size=(versions, 600)).astype(np.float32) / 8
    start = np.arange(600) - rng.integers(0, 25, size=(versions, 600))
    start = np.maximum(start, 0).astype(np.int32)
    distance[:, rng.random(600) < 0.2] = np.inf
    for threshold, top in ((np.inf, 600), (1.5, 600), (np.inf, 4)):
        expected = naive.select(distance, start, rate_hz, threshold, top)
        found = select_matches(distance.copy(), start, rate_hz, threshold=threshold, top=top)
        assert found == expected
        assert len(found) >= 4


def test_selection_without_a_match_is_empty():
    distance = np.full((1, 300), np.inf, np.float32)
    assert select_matches(distance, np.zeros((1, 300), np.int32), 30.0) == []


def test_a_threshold_is_not_itself_below_it():
    distance = np.array([[0.5, 0.25]], np.float32)
    start = np.array([[0, 1]], np.int32)
    assert select_matches(distance, start, 30.0, threshold=0.5) == [(0, 1, 1, 0.25)]


def test_neighboring_samples_of_one_frame_are_not_both_found():
    distance = np.array([[0.1, 0.2, 0.3, 0.4]], np.float32)
    start = np.arange(4, dtype=np.int32)[None]
    found = select_matches(distance.copy(), start, 15.0)  # frames 0 1 1 2
    assert [match[1] for match in found] == [0, 1, 3]


@pytest.mark.compiled
def test_a_threshold_changes_nothing_up_to_it(rng):
    left = 0
    for _ in range(40):
        samples, frames = int(rng.integers(200, 2500)), int(rng.integers(2, 60))
        knots = rng.normal(size=(6, samples // 10 + 2))
        take = [np.interp(np.arange(samples) / 10, range(knots.shape[1]), k) for k in knots]
        take = np.array(take).T.reshape(samples, 2, 3)
        first = int(rng.integers(samples - frames))
        query = take[first : first + frames] + rng.normal(size=(frames, 2, 3)) * 0.02
        for _ in range(4):
            long = int(rng.integers(frames // 2 + 1, 2 * frames))
            at = np.rint(np.linspace(0, frames - 1, long)).astype(int)
            place = int(rng.integers(samples - long))
            take[place : place + long] = query[at] + rng.normal(size=(long, 2, 3)) * 0.03
        take[rng.random(samples) < 0.002] = np.nan
        clip, rows = clip_of(query), rows_of(take)
        distance, start = run(clip, rows)
        for factor in (0.3, 1.0, 1.7):
            threshold = float(np.sort(distance)[10]) * factor
            found = np.empty(samples, np.float32), np.empty(samples, np.int32)
            warp_spans(clip, rows, np.array([[0, 0, samples]]), *found, threshold=threshold)
            near = distance <= threshold
            np.testing.assert_array_equal(found[0][near], distance[near])
            np.testing.assert_array_equal(found[1][near], start[near])
            assert (found[0][~near] > threshold).all()
            left += int((np.isinf(found[0]) & np.isfinite(distance)).sum()) / samples
    assert left > 10  # of 120


@pytest.mark.compiled
def test_many_spans_give_what_one_by_one_gives(rng):
    rows = rows_of(rng.normal(size=(900, 2, 3)))
    clip = clip_of(rng.normal(size=(9, 2, 3)))
    spans = np.array([[0, 0, 70], [54, 70, 71], [300, 316, 830], [832, 848, 900]])
    together = np.full(900, -1, np.float32), np.full(900, -1, np.int32)
    warp_spans(clip, rows, spans, *together)
    alone = np.full(900, -1, np.float32), np.full(900, -1, np.int32)
    for span in spans.tolist():
        warp(clip, rows, tuple(span), *alone)
    np.testing.assert_array_equal(together, alone)
