"""Tests of storage.blocks: what a stage made of some frames, between two tasks."""

import time
from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from storage import create_archive
from storage.blocks import (
    block_path,
    discard_blocks,
    find_block,
    keyed_path,
    read_block,
    remember_block,
    write_block,
)
from storage.errors import ArchiveError
from storage.kept import VARIABLE, Kept
from storage.places import list_files, read_file
from storage.upkeep.garbage import collect_garbage

DIGEST = "abcdef0123456789" * 4


@pytest.fixture
def place(tmp_path):
    return create_archive(tmp_path / "archive").place


@pytest.fixture
def arrays():
    rng = np.random.default_rng(5)
    return {
        "flags": rng.random(11) < 0.5,
        "color": rng.integers(0, 256, (7, 3), np.uint8),
        "offset": np.array([0, 3, 3, 7]),
        "none": np.zeros((0, 3), np.uint8),
        "by_columns": np.asfortranarray(rng.random((4, 6))),
        "one": np.array(2.5),
    }


def write(place, arrays, *, stage="carving", start=5, digest=DIGEST, take="okuri48"):
    path = keyed_path(block_path(take, digest, stage, start), "a" * 64)
    written = write_block(place, path, (start, start + 3), arrays, time.monotonic(), notes=["so"])
    remember_block(place, written)
    return written.block


@pytest.mark.parametrize("kept", ["0", "100"])
def test_a_block_gives_back_every_array_bit_for_bit(place, arrays, kept, monkeypatch):
    monkeypatch.setenv(VARIABLE, kept)
    monkeypatch.setattr("storage.blocks.KEPT", Kept())
    block = write(place, arrays)
    found = read_block(place, block)
    assert found.keys() == arrays.keys()
    for name, values in arrays.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)
        assert found[name].flags.writeable
    assert (block.start, block.end) == (5, 8)
    assert block.path.startswith("work/okuri48/")
    found = find_block(place, block.path)
    assert found is not None
    assert (found.block, found.notes) == (block, ("so",))


def test_blocks_of_other_settings_have_other_names_and_neither_finds_the_other(place, arrays):
    path = block_path("okuri48", DIGEST, "carving", 0)
    mine, other = keyed_path(path, "a" * 64), keyed_path(path, "b" * 64)
    remember_block(place, write_block(place, mine, (0, 3), arrays, time.monotonic()))
    assert find_block(place, mine)
    assert find_block(place, other) is None
    for folder in (place.folder / other).parents:
        assert folder.is_dir()
    for suffix in (".npz", ".json"):  # copied over by hand
        content = (place.folder / mine).with_suffix(suffix).read_bytes()
        (place.folder / other).with_suffix(suffix).write_bytes(content)
    assert find_block(place, other) is None


def test_seconds_are_those_since_the_stage_began(place, arrays, monkeypatch):
    monkeypatch.setattr("storage.blocks.time", SimpleNamespace(monotonic=lambda: 107.25))
    path = block_path("okuri48", DIGEST, "carving", 0)
    written = write_block(place, path, (0, 3), arrays, 100.0, notes=["so"])
    assert (written.seconds, written.notes, written.block.path) == (7.25, ("so",), path)


def test_equal_arrays_give_equal_digests_in_whatever_order_they_come(place, arrays):
    first = write(place, arrays)
    again = write(place, dict(reversed(arrays.items())))
    assert again.sha256 == first.sha256
    arrays["color"][6, 2] ^= 1
    assert write(place, arrays).sha256 != first.sha256


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[1]", b"{}", b'{"block": {"path": 1}}', b'{"block": null}', b"[" * 100_000],
)
def test_a_damaged_memory_is_none(place, arrays, content):
    block = write(place, arrays)
    (place.folder / block.path).with_suffix(".json").write_bytes(content)
    assert find_block(place, block.path) is None


@pytest.mark.parametrize("fault", ["flipped", "cut", "empty", "gone"])
def test_a_damaged_block_is_never_read(place, arrays, fault, monkeypatch):
    monkeypatch.setenv(VARIABLE, "0")
    monkeypatch.setattr("storage.blocks.KEPT", Kept())  # other tests kept what is equal
    block = write(place, arrays)
    path = place.folder / block.path
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    if fault == "gone":
        path.unlink()
    else:
        path.write_bytes({"flipped": content, "cut": content[:-1], "empty": b""}[fault])
    assert find_block(place, block.path) is None
    with pytest.raises(ArchiveError, match=r"carving-00000005-a{12}\.npz was changed or removed"):
        read_block(place, block)


def test_blocks_go_and_those_of_others_stay(place, arrays):
    done = [write(place, arrays), write(place, arrays, stage="coloring")]
    others = [write(place, arrays, digest="f" * 64), write(place, arrays, take="okuri48-b")]
    discard_blocks(place, done)
    left = {file.path for file in list_files(place, "work") if file.path.endswith(".npz")}
    assert left == {each.path for each in others}
    discard_blocks(place, others[:1])
    assert not (place.folder / "work/okuri48").exists()
    discard_blocks(place, done)


def test_blocks_that_nobody_goes_on_with_are_garbage_when_they_are_old(place, arrays):
    block = write(place, arrays)
    assert collect_garbage(place, older_than=timedelta(hours=1)) == []
    removed = collect_garbage(place, older_than=timedelta(0))
    assert block.path in {file.path for file in removed}
    assert len(removed) == 2
    assert list_files(place, "work") == []


@pytest.mark.s3
def test_blocks_live_in_an_object_store_too(object_store, arrays):
    place = create_archive(object_store).place
    block, other = write(place, arrays), write(place, arrays, take="okuri48-b")
    np.testing.assert_array_equal(read_block(place, block)["color"], arrays["color"])
    assert find_block(place, block.path)
    discard_blocks(place, [block])
    assert find_block(place, block.path) is None
    assert find_block(place, other.path)
    with pytest.raises(FileNotFoundError):
        read_file(place, block.path)
