"""Wrong use and bad input: one sentence, and an exit code that tells them apart."""

import re
import sys
from pathlib import Path

import pytest

from storage import create_archive, open_archive
from storage.errors import PlaceError
from storage.recordings import plan_takes
from storage.schema import parse_frames
from tasks.motion.importing import ImportSettings, import_take
from tests.flows.command.conftest import run


def test_wrong_settings_are_refused_before_prefect_starts(archive, capsys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "flows.ingestion", None)  # importing it would fail
    file = tmp_path / "my.toml"
    file.write_text('[pose_fitting]\nmethod = "papre"\n[carving]\nmin_camera = 2\n')
    code, out, err = run(capsys, "ingest", archive, tmp_path / "inbox", "--settings", file)
    assert (code, out) == (3, "")
    assert 'method = \'papre\' should be one of "joint", "paper"' in err
    assert "no setting 'carving.min_camera'; carving.min_cameras is meant?" in err
    code, _, err = run(capsys, "ingest", archive, tmp_path / "inbox", "--settings", "none.toml")
    assert code == 3
    assert "none.toml cannot be read" in err


WRONG_USE = {
    "take": (["search", "A", "okuri"], "has no take 'okuri'; did you mean okuri4"),
    "part": (["search", "A", "okuri48", "--part", "feets"], "'feets'.*feet"),
    "joint": (["search", "A", "okuri48", "--weight", "RFot=1"], "'RFot'.*RFoot"),
    "weight": (["search", "A", "okuri48", "--weight", "RFoot=big"], "should be JOINT=W"),
    "zero": (["search", "A", "okuri48", "--part", "head", "--weight", "Head=0", "--weight",
              "Neck=0"], "weight"),
    "clip": (["search", "A", "okuri48:70-90"], "70-90.*79"),
    "order": (["search", "A", "okuri48:50-20"], "should be START-END"),
    "pattern": (["search", "A", "okuri48", "--takes", "x*"], "no take of .* is called 'x\\*'"),
    "top": (["search", "A", "okuri48", "--top", "0"], "ask for 1 or more"),
    "show": (["show", "A", "radi"], "did you mean radio"),
    "frames": (["export", "A", "radio", "out.trc", "--frames", "5"], "should be START-END"),
    "hours": (["gc", "A", "--older-than", "-1"], "should be hours, 0 or more"),
    "many hours": (["gc", "A", "--older-than", "1e300"], "should be hours, 0 or more, and 878,400"),
    "many frames": (["export", "A", "radio", "out.trc", "--frames", "0-" + "9" * 5000],
                    r"frames '0-9{38}\.\.\.' should be START-END"),
    "long clip": (["search", "A", "okuri48:0-" + "9" * 5000], "9{60,80}' should be START-END"),
    "heavy": (["search", "A", "okuri48", "--weight", "RFoot=1e300"], "give a number from 0 up to"),
    "light": (["search", "A", "okuri48", "--weight", "RFoot=1e-300"], "give a number from 0 up to"),
    "path": (["search", "A", "okuri48", "--path-weight", "1e300"], "path weight is 1e.300; give"),
    "twice": (["search", "A", "okuri48", "--weight", "RFoot=1", "--weight", "RFoot=2"],
              "RFoot has a weight already"),
    "scale of a take": (["search", "A", "okuri48", "--scale", "0"], "is a take; leave it out"),
    "scale": (["search", "A", "a.trc", "--scale", "nan"], "--scale nan should be a number above 0"),
    "flow": (["search", "A", "okuri", "--flow"], "has no take 'okuri'; did you mean okuri4"),
    "flow's part": (["search", "A", "okuri48", "--flow", "--part", "x"], "there is no part 'x'"),
    "scale of files": (["ingest", "A", ".", "--scale", "nan"], "--scale nan should be a number"),
    "low pass": (["ingest", "A", ".", "--low-pass", "-1"], "--low-pass -1 should be a number"),
    "pictures": (["doctor", "--out", "x"], "--out is for pictures of captures; name a capture"),
    "cameras": (["doctor", "--refine"], "--refine is for the cameras of a capture; name one"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_USE)
def test_wrong_use_is_one_sentence_and_exit_code_2(archive, capsys, monkeypatch, case):
    for module in ("flows.ingestion", "flows.searching"):
        monkeypatch.setitem(sys.modules, module, None)  # Prefect is not started for it
    arguments, message = WRONG_USE[case]
    code, out, err = run(capsys, *[archive if each == "A" else each for each in arguments])
    assert code == 2
    assert out == ""
    assert re.search(message, err)
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_bad_input_is_one_sentence_and_exit_code_3(archive, capsys, tmp_path):
    (tmp_path / "noise.bvh").write_bytes(bytes(range(256)))
    cases = [
        (["takes", tmp_path / "none"], "there is no directory"),
        (["takes", tmp_path], "is not an archive"),
        (["search", archive, tmp_path / "noise.bvh"], "noise.bvh"),
        (["search", archive, tmp_path / "none.trc"], "none.trc"),
        (["export", archive, "radio", tmp_path / "out.xyz"], "should end in one of"),
        (["export", archive, "radio", tmp_path / "out.obj"], "should end in one of"),
        (["export", archive, "radio", tmp_path / "o.trc", "--frames", "0-99"], "goes beyond"),
    ]
    for arguments, message in cases:
        code, out, err = run(capsys, *arguments)
        assert (code, out) == (3, ""), err
        assert message in err
        assert err.count("\n") == 1


def test_bad_input_is_said_before_prefect_starts(archive, capsys, tmp_path, monkeypatch):
    for module in ("flows.ingestion", "flows.indexing", "flows.searching"):
        monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").touch()
    for arguments, message in (
        (["ingest", archive, tmp_path / "none"], "none is not there"),
        (["ingest", tmp_path / "full", tmp_path / "inbox"], "is not an archive and not empty"),
        (["index", tmp_path / "full"], "is not an archive"),
        (["search", archive, tmp_path / "none.trc", "--flow"], "none.trc is no file"),
    ):
        code, out, err = run(capsys, *arguments)
        assert (code, out) == (3, ""), err
        assert message in err
        assert err.count("\n") == 1


def test_what_no_one_foresaw_is_one_sentence_and_in_full_with_verbose(archive, capsys, monkeypatch):
    def broken(_):
        raise KeyError("x")

    monkeypatch.setattr("flows.command.main.open_archive", broken)
    code, _, err = run(capsys, "takes", archive)
    assert code == 4
    assert err == (
        "shosa: this is a fault of the program (KeyError: 'x'); run it with --verbose and report "
        "what it says\n"
    )
    code, _, err = run(capsys, "--verbose", "takes", archive)
    assert code == 4
    assert "in broken" in err


def test_an_archive_of_a_newer_format_is_said(archive, capsys):
    Path(archive, "archive.json").write_text('{"version": 9}')
    code, _, err = run(capsys, "takes", archive)
    assert code == 3
    assert "update shosa" in err


def test_a_disk_that_fills_up_in_the_middle_leaves_nothing_half_written(small_disk, write_walk):
    file = write_walk(small_disk.parent / "long.trc", frames=3000)
    location = small_disk / "archive"
    [recording] = plan_takes(create_archive(location), [file]).recordings
    with pytest.raises(PlaceError, match="No space left on device; free some space"):
        import_take(str(location), recording, ImportSettings())
    assert not [path for path in (location / "takes").rglob("*") if path.is_file()]
    assert open_archive(location).takes() == []


def test_frames_are_two_numbers_in_order():
    assert parse_frames("0-0") == (0, 0)
    for text in ("5", "5-", "9-5", "a-b", "-1-5"):
        with pytest.raises(ValueError, match="should be START-END"):
            parse_frames(text)
