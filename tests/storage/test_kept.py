"""Tests of what is kept in memory of blocks: never more than allowed, and nobody's to change."""

import numpy as np
import pytest

from flows.command.main import main
from storage.kept import VARIABLE, Kept, kept_limit

MB = np.zeros(1_000_000, np.uint8)


@pytest.fixture(autouse=True)
def limit(monkeypatch):
    monkeypatch.setenv(VARIABLE, "3")


def test_what_was_used_longest_ago_goes_first():
    kept = Kept()
    for name in "abc":
        kept.keep(name, {"array": MB})
    assert kept.find("a", None)
    kept.keep("d", {"array": MB})
    assert [name for name in "abcd" if kept.find(name, None)] == ["a", "c", "d"]
    kept.keep("large", {"array": np.zeros(3_000_001, np.uint8)})
    assert kept.find("large", None) is None
    assert kept.find("a", None)
    kept.discard(["a", "never there"])
    kept.keep("d", {"array": MB})  # again: it counts once
    kept.keep("e", {"array": MB})
    assert [name for name in "acde" if kept.find(name, None)] == ["c", "d", "e"]


def test_who_wrote_and_who_read_may_write_to_their_arrays():
    kept, array = Kept(), np.arange(5)
    kept.keep("a", {"array": array, "other": array})
    array[:] = 9
    read = kept.find("a", ["array"])
    assert [*read] == ["array"]
    read["array"][:] = 7
    np.testing.assert_array_equal(kept.find("a", None)["array"], np.arange(5))


def test_a_limit_of_nothing_keeps_nothing(monkeypatch):
    monkeypatch.setenv(VARIABLE, "0")
    kept = Kept()
    kept.keep("a", {"array": MB})
    assert kept.find("a", None) is None


@pytest.mark.parametrize("given", ["-1", "much", "1e3", "0.5", "999999999999"])
def test_a_limit_that_means_nothing_is_wrong_use(given, monkeypatch, tmp_path, capsys, write_walk):
    monkeypatch.setenv(VARIABLE, given)
    with pytest.raises(ValueError, match=f"{VARIABLE}={given} should be megabytes from 0"):
        kept_limit()
    walk = str(write_walk(tmp_path / "walk.trc"))
    for command in (["ingest", str(tmp_path / "archive"), walk], ["serve", str(tmp_path / "a")]):
        assert main(command) == 2
        assert f"{VARIABLE}={given} should be megabytes" in capsys.readouterr().err
    assert not (tmp_path / "archive").exists()
