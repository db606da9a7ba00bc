import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.retrieval.pruned import bounds
from tasks.retrieval.pruned.bounds import bound_ends, coarsen, nearest_match
from tasks.retrieval.pruned.summaries import (
    SPREAD_MISSING,
    SPREAD_ROWS,
    SPREAD_UNKNOWN,
    SUMMARIES,
    spread_row,
    summarize_rows,
)
from tests.twins import bounds as naive
from tests.twins.search import distances, warp_slope

LENGTHS = (4, 8)


@pytest.fixture
def rng():
    return np.random.default_rng(19)


def altered(*edits, tile=None):
    """Return the module of the bound, interpreted, with its text edited."""
    text = Path(bounds.__file__).read_text()
    text = text.replace("from tasks.engine.kernels import njit\n", "")
    if tile:
        edits = (*edits, ("_TILE = 256", f"_TILE = {tile}"), ("_LANES = 32", "_LANES = 2"))
    for old, new in edits:
        assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in the kernel"
        text = text.replace(old, new)
    # dataclasses look their module up by name
    names = {"njit": lambda **_: lambda function: function, "__name__": bounds.__name__}
    exec(compile(text, "altered bounds", "exec"), names)
    return SimpleNamespace(**names)


def packed(positions):
    """Return positions (frame, joint, 3) as packed rows, the others zero."""
    rows = np.zeros((69, len(positions)), np.float32)
    rows[: 3 * positions.shape[1]] = positions.reshape(len(positions), -1).T
    return rows


def clip_of(query, weights=None):
    joints = query.shape[1]
    weights = np.full(joints, 1 / joints) if weights is None else np.array(weights)
    columns = np.stack([np.arange(3 * joints), np.full(3 * joints, -1)], axis=1)
    flat = np.ascontiguousarray(query.reshape(len(query), -1), np.float32)
    return flat, weights.astype(np.float32), columns


def wander(rng, frames, joints=2, step=0.05):
    return rng.normal(size=(frames, joints, 3)).cumsum(axis=0) * step


def stretched(motion, frames):
    at = np.linspace(0, len(motion) - 1, frames)
    return motion[np.rint(at).astype(int)]


def switching(rng, frames, runs, phase=0):
    """Return one joint that stands still for runs of so many frames: then bounds are tight."""
    lengths = rng.choice(runs, frames)
    values = rng.choice([0.0, 0.0, 0.3, 0.5, 1.0], frames)
    line = np.repeat(values, lengths)[phase : phase + frames]
    return line[:, None, None] * np.array([1.0, 0, 0])


def cases(rng):
    """Yield queries and takes (frame, joint, 3) of the kinds that have broken such bounds."""
    for frames in (9, 16, 23):
        for runs in ([8], [4], [16, 8], [1, 7], [4, 12], [2, 6], [3, 5, 13]):
            query = switching(rng, frames, [4, 8, 32])
            take = switching(rng, 104, runs)
            # at a tile's edge of 8 blocks of 8 or 4 frames, at half, whole and double speed
            first = int(rng.choice([29, 31, 32, 61, 63]))
            length = int(rng.choice([frames // 2 + 1, frames, 2 * frames - 1]))
            take[first : first + length] = stretched(query, length)[: 104 - first]
            yield query, take
        take[50:58] = np.nan
        take[rng.random(104) < 0.02] = np.nan
        yield query, take
        query = wander(rng, frames)
        take = wander(rng, 104)
        take[40 : 40 + 2 * frames - 1] = stretched(query, 2 * frames - 1)
        yield query, take


def rare_cases(rng):
    """Yield matches of a few frames of a block, and what is further away than can be said."""
    here, there = np.array([[1.0, 0, 0]]), np.array([[0, 3.0, 0]])
    query, take = np.repeat([here, there], [4, 5], axis=0), np.zeros((104, 1, 3))
    take[45:48], take[48:56] = here, there  # three frames of a block, then a whole one
    yield query, take
    query, take = np.repeat([there, here], [4, 5], axis=0), np.zeros((104, 1, 3))
    take[40:48], take[48:51] = there, here
    yield query, take
    query, take = wander(rng, 16), wander(rng, 110)
    query[::3] += 5.0
    take[60:76] = query
    yield query, take


def violations(module, query, take, thresholds=(0.02, 0.2, 0.6)):
    """Return by how much the bound exceeds the true least excess, and the share it rules out."""
    clip, rows = clip_of(query), packed(take)
    frames = rows[: clip[0].shape[1]].T.reshape(len(take), -1, 3)
    joints = query.shape[1]
    d = distances(clip[0].reshape(len(query), -1, 3), frames, np.ones(joints))
    g, start = warp_slope(d)
    found = g / (len(query) + np.arange(len(take)) - start)
    summaries = summarize_rows(rows)
    worst, ruled_out, ends = 0.0, 0, 0
    for length in LENGTHS:
        coarse = module.coarsen(clip, length)
        blocks = -(-len(take) // length)
        for threshold in thresholds:
            excess = np.full(blocks, np.nan, np.float32)
            spans = np.array([[0, 0, blocks]])
            mean, spread = summaries[f"mean_{length}"], summaries[f"spread_{length}"]
            module.bound_ends(coarse, mean, spread, spans, threshold, excess)
            true = np.full(blocks * length, np.inf)
            true[: len(take)] = naive.least_excess(d, threshold)
            least = true.reshape(-1, length).min(axis=1)
            worst = max(worst, float((excess - least)[np.isfinite(least)].max()))
            # a scan's least g is no less than the least excess: what it finds within is left
            near = np.full(blocks * length, np.inf)
            near[: len(take)] = found
            assert (
                worst > 0
                or not ((near.reshape(-1, length).min(axis=1) <= threshold) & (excess > 0)).any()
            )
            nearest = module.nearest_match(coarse, threshold, excess)
            below = np.minimum(near, threshold).reshape(-1, length).min(axis=1) - nearest
            worst = max(worst, -float(below.min()))
            ruled_out += int((excess > 0).sum())
            ends += blocks
    return worst, ruled_out / ends


def test_weights_count_rows_and_columns_where_they_first_appear():
    seen = 0
    for path in naive.every_path(4, 7):
        rows, columns = naive.counts(path)
        first = path[0][1]
        assert sum(rows.values()) == sum(w for _, _, w in path) == 4 + path[-1][1] - first
        assert set(rows) == set(range(4))
        assert {*rows.values(), *columns.values()} <= {1, 2, 3}
        assert set(columns) == set(range(first, path[-1][1] + 1))
        seen += 1
    assert seen > 20


@pytest.mark.parametrize("rows", [4, 5, 7, 8])
def test_a_query_block_lasts_from_half_to_twice_its_frames(rows):
    # from leaving row 1, the last of the block before, to leaving the last row
    lasted = set()
    for path in naive.every_path(rows + 1, 2 * rows + 1):
        leaves = {i: j for i, j, _ in path}
        lasted.add(leaves[rows] - leaves[0])
    assert min(lasted) >= -(-(rows - 1) // 2)
    assert max(lasted) <= 2 * rows


def test_the_bound_is_never_above_the_least_excess_of_any_path(rng):
    interpreted = altered(tile=8)
    ruled_out = []
    for query, take in (*cases(rng), *rare_cases(rng)):
        worst, share = violations(interpreted, query, take)
        assert worst <= 0
        ruled_out.append(share)
    assert np.mean(ruled_out) > 0.2
    assert min(ruled_out) < 0.1


@pytest.mark.compiled
def test_the_compiled_bound_is_the_interpreted_one(rng):
    interpreted = altered()
    for query, take in cases(rng):
        clip, summaries = clip_of(query), summarize_rows(packed(take))
        for length in LENGTHS:
            mean, spread = summaries[f"mean_{length}"], summaries[f"spread_{length}"]
            found = []
            for module in (bounds, interpreted):
                excess = np.zeros(mean.shape[1], np.float32)
                spans = np.array([[0, 2, 9], [9, 9, mean.shape[1]]])
                module.bound_ends(module.coarsen(clip, length), mean, spread, spans, 0.1, excess)
                found.append(excess)
            np.testing.assert_allclose(*found, rtol=1e-4, atol=1e-4)
            assert (found[0][:2] == 0).all()


MUTANTS = {
    "E raised to -tau cell by cell": (
        "v = x[b] - alpha[a] - beta[b] - tau",
        "v = max(x[b] - alpha[a] - beta[b] - tau, -tau)",
    ),
    "a tile hands on no sums of paths that begin in it": (
        "now[:_REACH], source[:_REACH] = edge_e[a], edge_g[a]",
        "now[:_REACH], source[:_REACH] = edge_e[a], edge_g[a] if a else _FAR",
    ),
    "a tile hands on nothing": (
        "now[:_REACH], source[:_REACH] = edge_e[a], edge_g[a]",
        "now[:_REACH], source[:_REACH] = edge_e[a], _FAR",
    ),
    "the first block as if whole": ("begin = -np.float32(length - 1) * beta[b]", "begin = 0"),
    "the last block as if whole": (
        "v - np.float32(length - 1) * beta[b] - rounding",
        "v - rounding",
    ),
    "no spread of the take": ("alpha[a] - beta[b] - tau", "alpha[a] - tau"),
    "no spread of the query": ("x[b] - alpha[a] -", "x[b] -"),
    "paths advance by at most seven units": ("range(_REACH):", "range(_REACH - 1):"),
    "paths advance by at least two units": ("range(_REACH):", "range(1, _REACH):"),
    "what is crossed counts twice": ("crossed += unit * e", "crossed += 2 * unit * e"),
    "an unknown spread is small": ("-_FAR if worst[b] == SPREAD_MISSING else _FAR", "-_FAR"),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_a_wrong_bound_is_seen_to_be_wrong(rng, mutant):
    wrong = altered(MUTANTS[mutant], tile=8)
    for query, take in itertools.chain(rare_cases(rng), cases(rng)):
        if violations(wrong, query, take)[0] > 0:
            return
    pytest.fail("nothing tells this bound from a right one")


def test_a_query_that_is_no_motion_or_too_short_is_not_bounded(rng):
    assert coarsen(clip_of(wander(rng, 3)), 8) is None
    assert coarsen(clip_of(wander(rng, 4)), 8) is not None
    far = wander(rng, 20)
    far[7] = 1e6
    assert coarsen(clip_of(far), 8) is None
    far[7] = np.nan
    assert coarsen(clip_of(far), 8) is None


@pytest.mark.parametrize("frames", [4, 5, 8, 9, 17, 23, 170])
def test_blocks_of_a_query_have_from_half_the_frames_to_all(rng, frames):
    for length in LENGTHS:
        coarse = coarsen(clip_of(wander(rng, frames)), length)
        assert length // 2 <= coarse.size.min() <= coarse.size.max() <= length
        assert coarse.size.sum() == frames


def test_the_bound_agrees_with_its_naive_twin(rng):
    query, take = wander(rng, 30), wander(rng, 160)
    clip, summaries = clip_of(query), summarize_rows(packed(take))
    for length in LENGTHS:
        coarse = coarsen(clip, length)
        mean, spread = summaries[f"mean_{length}"], summaries[f"spread_{length}"]
        beta = (spread[:2].astype(float) / 161) ** 2
        means = mean[:6].astype(float) / 8192
        apart = coarse.mean[:, :, None] - means
        apart = np.sqrt((apart.reshape(len(coarse.mean), 2, 3, -1) ** 2).sum(axis=2)).mean(axis=1)
        e = apart - coarse.alpha[:, None] - beta.mean(axis=0) - 0.2
        excess = np.empty(mean.shape[1], np.float32)
        bound_ends(coarse, mean, spread, np.array([[0, 0, len(excess)]]), 0.2, excess)
        expected = naive.coarse_excess(e, coarse.size, beta.mean(axis=0), length)
        possible = np.isfinite(expected)
        assert (excess[~possible] > 1e6).all()
        assert possible.sum() > len(excess) / 2
        lowered = expected[possible] - excess[possible]  # by the margin, which is rounding
        assert lowered.min() > 0
        assert lowered.max() < 0.1
        assert np.isfinite(nearest_match(coarse, 0.2, excess)).all()


def test_summaries_have_the_shapes_that_are_said(rng):
    for samples in (1, 7, 64, 101):
        made = summarize_rows(rng.normal(size=(69, samples)).astype(np.float32))
        assert made.keys() == SUMMARIES.keys()
        for name, (dtype, rows, block) in SUMMARIES.items():
            assert made[name].dtype == dtype
            assert made[name].shape == (rows, -(-samples // block))


@pytest.mark.parametrize("origin", [-1, 63])
def test_a_spread_is_no_less_than_any_weighted_mean_and_not_much_more(rng, origin):
    rows = rng.normal(size=(69, 80)).astype(np.float32) * 0.2
    rows[0:3, 17:19] = np.nan
    made = summarize_rows(rows)
    place = spread_row(0, origin)
    apart = rows[0:3] - (rows[63:66] if origin == 63 else 0)
    for block in LENGTHS:
        center = made[f"mean_{block}"][0:3].astype(float)
        center = (center - (made[f"mean_{block}"][63:66] if origin == 63 else 0)) / 8192
        for b in range(80 // block):
            part = apart[:, b * block : (b + 1) * block] - center[:, b : b + 1]
            values = np.sqrt((part**2).sum(axis=0))
            worst = naive.worst_mean(values[np.isfinite(values)])
            spread = (made[f"spread_{block}"][place, b] / 161) ** 2
            assert worst <= spread <= worst + 2 * np.sqrt(spread) / 161 + 1e-4


def test_what_cannot_be_summarized_is_said(rng):
    rows = rng.normal(size=(69, 48)).astype(np.float32) * 0.1
    rows[3:6, 8:16] = np.nan
    rows[6:9, 17] = 1e30
    rows[9:12, 24:32] = 7.5
    rows[12, 33] = np.inf
    made = summarize_rows(rows)
    spread = made["spread_8"]
    assert spread[1].tolist().count(SPREAD_MISSING) == 1 == (spread[1, 1] == SPREAD_MISSING)
    assert spread[2, 2] == spread[3, 3] == spread[4, 4] == SPREAD_UNKNOWN
    assert (spread[:5] == SPREAD_UNKNOWN).sum() == 3
    assert made["mean_8"][9, 3] == 32767  # four statures is as far as it reaches
    assert len(spread) == SPREAD_ROWS
