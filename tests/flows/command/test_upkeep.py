"""The commands that look after an archive: what is damaged, lost or garbage; and `doctor`."""

import re
import shutil
from pathlib import Path

import pytest

from storage import open_archive
from storage.arrays.search import search_array_path
from tests.flows.command.conftest import run


def test_verify_tells_what_is_damaged(archive, capsys):
    assert run(capsys, "verify", archive)[0] == 0
    take = open_archive(archive).take("okuri48")
    Path(archive, search_array_path("okuri48", take.record.version)).unlink()
    chunk = Path(open_archive(archive).take("radio").path, "motion/position/c/0/0/0")
    chunk.write_bytes(b"")
    code, out, err = run(capsys, "verify", archive)
    assert code == 3
    assert "take 'radio': takes/radio" in out
    assert "take 'okuri48' has no search array; run `shosa index`" in out
    assert "4 takes verified, 2 faults" in err


def test_garbage_is_listed_and_removed(archive, capsys):
    stray = Path(archive, "takes/radio/000009-deadbeef/zarr.json")
    stray.parent.mkdir()
    stray.write_text("{}")
    assert run(capsys, "gc", archive)[1] == ""
    code, out, err = run(capsys, "gc", archive, "--older-than", "0")
    assert (code, out) == (0, "takes/radio/000009-deadbeef/zarr.json\n")
    assert "removed 1 files" in err
    assert not stray.parent.exists()


def test_a_damaged_record_is_said_and_the_other_takes_are_listed_and_searched(archive, capsys):
    [path] = Path(archive, "published", "radio").iterdir()
    path.write_text(path.read_text().replace('"frames": 83', '"frames": 82'))
    code, out, err = run(capsys, "takes", archive)
    assert code == 3
    assert len(out.splitlines()) == 4
    assert "radio/000001.json is damaged (it is not what was published)" in err
    code, out, err = run(capsys, "search", archive, "okuri48:20-50")
    assert code == 0
    assert "radio" not in out
    assert re.search("not compared: radio: .*is damaged", err)
    for command in (["show", archive, "radio"], ["search", archive, "radio"], ["verify", archive]):
        code, out, err = run(capsys, *command)
        assert code == 3
        assert "is damaged" in out + err


def test_a_damaged_take_is_not_exported(archive, capsys, tmp_path):
    chunk = Path(open_archive(archive).take("radio").path, "motion/position/c/0/0/0")
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 1
    chunk.write_bytes(data)
    for suffix in ("trc", "c3d", "csv", "bvh"):
        code, _, err = run(capsys, "export", archive, "radio", tmp_path / f"out.{suffix}")
        assert code == 3
        assert re.search("take 'radio' is damaged.*shosa verify", err)
        assert err.count("\n") == 1
        assert not (tmp_path / f"out.{suffix}").exists()


def test_a_take_whose_record_was_lost_is_kept_until_it_is_asked_for(archive, capsys):
    shutil.rmtree(Path(archive, "published", "radio"))
    code, out, err = run(capsys, "gc", archive, "--older-than", "0")
    assert (code, out) == (0, "")
    assert re.search("takes/radio/.* has no record in published/.*copy sources/radio/.*--lost", err)
    code, out, err = run(capsys, "verify", archive)
    assert code == 3
    assert "takes/radio/" in out
    code, out, _ = run(capsys, "gc", archive, "--older-than", "0", "--lost")
    assert code == 0
    assert "takes/radio/" in out
    assert run(capsys, "verify", archive)[0] == 0


@pytest.mark.slow
def test_the_doctor_finds_this_installation_well(capsys):
    code, out, _ = run(capsys, "doctor")
    assert code == 0, out
    assert "the search kernel compiles and finds" in out
