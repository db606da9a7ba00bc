"""The benchmark of the search runs, and what its constraints find is what the search finds."""

import numpy as np
import pytest

from tasks.retrieval.searching import SearchSettings, search_takes
from tests.benchmarks.similarity import retrieval
from tests.benchmarks.similarity.path_constraints import CONSTRAINTS, warp_by
from tests.benchmarks.similarity.truth import RATE_HZ, cut, overlap, packed
from tests.conftest import swaying_body

pytestmark = [pytest.mark.slow, pytest.mark.compiled, pytest.mark.long]


@pytest.mark.parametrize(
    ("constraint", "steps"),
    [("P = 1: lengths 1/2 to 2 (slope)", "slope"), ("P = 0: any length", "paper")],
)
def test_a_constraint_is_that_of_the_search(constraint, steps):
    take, asked = (packed(name, swaying_body(seed, 120)) for name, seed in (("a", 1), ("b", 2)))
    query = cut(asked, 20, 45)
    ours = warp_by(CONSTRAINTS[constraint], query, take)
    theirs = search_takes(query, [take], SearchSettings(steps=steps, top=len(ours))).matches
    if steps == "slope":
        assert [(m.start, m.end) for m in theirs] == [(first, last) for first, last, _ in ours]
        np.testing.assert_allclose([m.distance for m in theirs], [m[2] for m in ours], rtol=1e-4)
    else:  # the paper's first row goes on, and its best match is no worse for it
        assert theirs[0].distance <= ours[0][2] * (1 + 1e-5)


def test_frames_in_common_are_over_the_frames_of_either():
    assert overlap((0, 9), (0, 9)) == 1
    assert overlap((0, 9), (5, 14)) == pytest.approx(5 / 15)
    assert overlap((0, 9), (10, 14)) == 0


def test_a_quick_run_without_recordings_says_so(tmp_path, capsys):
    retrieval.main(["--quick", "--data", str(tmp_path / "none")])
    said = capsys.readouterr().out
    assert "There is no recorded dance at" in said
    table = said.split("generated performers\n")[1].split("\n\n")[0]
    [slope] = [
        line.split() for line in table.splitlines() if line.split()[:2] == ["whole", "slope"]
    ]
    precision, of_ten, of_all, half, tenth = map(float, slope[2:])
    assert precision > 0.9
    assert of_ten > 0.9
    assert of_all > 0.9
    assert half == tenth == 0


@pytest.mark.data
def test_a_quick_run_with_recordings_prints_every_table(shared_data, capsys):
    retrieval.main(["--quick", "--data", str(shared_data / "mocap")])
    said = capsys.readouterr().out
    for title in ("levels are made from", "altered clips", "partner too", "chances told"):
        assert title in said
    rows = [line.split() for line in said.splitlines() if line.strip().startswith("as it was")]
    assert rows[0][3:6] == ["1.00", "1.00", "0.000"]
    assert RATE_HZ == 30.0
