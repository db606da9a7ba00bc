"""Tests of the command line: every sub-command's help, real runs, and wrong use."""

import io
import json
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from flows.command.exits import INTERRUPTED
from flows.command.main import build_parser, main
from storage import create_archive, open_archive
from storage.arrays.search import search_array_path
from storage.errors import PlaceError
from storage.formats import read_motion_file
from storage.recordings import find_recordings, plan_takes
from storage.schema import JOINTS, parse_frames
from tasks.motion.importing import ImportSettings, import_take
from tasks.motion.stature import joints_present
from tasks.retrieval import archive_search
from tasks.retrieval.indexing import index_take
from tasks.retrieval.normalization import pack_motion
from tasks.retrieval.searching import Found, Match, SearchSettings, clip_take, search_takes
from tasks.retrieval.segments import PackedTake
from tasks.takes.publishing import publish_take

COMMANDS = (
    *("demo", "ingest", "serve", "plan", "render", "takes", "show", "path", "search", "index"),
    *("view", "report", "export", "calibrate", "verify", "gc", "doctor", "settings"),
)


@pytest.fixture
def archive(tmp_path, write_walk):
    """Four takes, ingested by the very functions that the flow calls."""
    folder = tmp_path / "inbox"
    for number, name in enumerate(("okuri48", "okuri49", "lonely", "radio")):
        write_walk(folder / f"{name}.trc", seed=number, frames=80 + number)
    (folder / "okuri48.toml").write_text('[take]\ntitle = "Okuri 48"\nperformer = "TK"\n')
    location = tmp_path / "archive"
    plan = plan_takes(create_archive(location), find_recordings([folder]))
    for recording in plan.recordings:
        draft = import_take(str(location), recording, ImportSettings())
        index_take(str(location), draft["take"], draft["version"])
        publish_take(str(location), draft, over=0)
    return str(location)


def run(capsys, *arguments):
    """Run the command in this process; return exit code, output and messages."""
    code = main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_what_it_does(capsys, command):
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert f"usage: shosa {command}" in capsys.readouterr().out


def test_the_commands_are_those_of_the_design():
    [commands] = (a for a in build_parser()._actions if a.nargs == "A...")
    assert set(commands.choices) == set(COMMANDS)


def test_takes_lists_what_the_archive_has(archive, capsys):
    code, out, _ = run(capsys, "takes", archive)
    assert code == 0
    assert re.search(r"okuri48 +trc +80 +30 +2\.7 +TK +Okuri 48", out)
    _, out, _ = run(capsys, "takes", archive, "--json")
    listed = json.loads(out)["takes"]
    assert [take["take"] for take in listed] == ["lonely", "okuri48", "okuri49", "radio"]
    assert listed[1] == {
        "take": "okuri48",
        "source": "trc",
        "title": "Okuri 48",
        "performer": "TK",
        "frames": 80,
        "rate_hz": 30.0,
        "stages": ["motion"],
    }


def test_show_and_path_tell_of_one_take(archive, capsys):
    _, out, _ = run(capsys, "show", archive, "okuri48")
    for words in ("80 frames at 30 Hz", "21 of 21", "1, published", "okuri48.trc", "performer"):
        assert words in out
    _, out, _ = run(capsys, "show", archive, "okuri48", "--json")
    assert json.loads(out)["joints_missing"] == []
    _, out, _ = run(capsys, "path", archive, "okuri48")
    assert Path(out.strip(), "motion", "zarr.json").is_file()


def test_show_tells_the_settings_that_are_not_the_defaults(archive, capsys):
    record = open_archive(archive).take("okuri48").record
    [path] = Path(archive, "published", "okuri48").iterdir()
    changed = {**asdict(record), "settings": {"pose_fitting.method": "paper"}}
    path.write_text(json.dumps(changed))
    _, out, _ = run(capsys, "show", archive, "okuri48")
    assert re.search(r'^set +pose_fitting\.method = "paper", not the default$', out, re.MULTILINE)
    _, out, _ = run(capsys, "show", archive, "okuri48", "--json")
    assert json.loads(out)["settings"] == {"pose_fitting.method": "paper"}


def test_a_record_of_before_settings_were_kept_is_read(archive, capsys):
    [path] = Path(archive, "published", "okuri48").iterdir()
    old = json.loads(path.read_text())
    del old["settings"]
    path.write_text(json.dumps(old))
    code, out, _ = run(capsys, "show", archive, "okuri48", "--json")
    assert (code, json.loads(out)["settings"]) == (0, {})


def test_settings_are_printed_as_toml_and_as_json(capsys):
    code, out, _ = run(capsys, "settings")
    assert code == 0
    assert tomllib.loads(out)["pose_fitting"]["method"] == "joint"
    assert "# How the pose is fitted" in out
    _, out, _ = run(capsys, "settings", "--json")
    [method] = [s for s in json.loads(out)["settings"] if s["name"] == "pose_fitting.method"]
    assert (method["value"], method["accepted"]) == ("joint", 'one of "joint", "paper"')


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


def test_search_finds_the_clip_itself_first(archive, capsys):
    code, out, err = run(capsys, "search", archive, "okuri48:20-50", "--part", "arms", "--top", 3)
    assert code == 0
    assert re.search(r"\n +1 +0\.0000 +same +\S.* okuri48 +20-50 +0\.67-1\.67 +TK +Okuri 48\n", out)
    assert re.search(r"3 matches in \d takes; searched 4 takes, 326 frames, in", err)


def test_search_prints_the_json_of_the_design(archive, capsys):
    _, out, _ = run(
        capsys, "search", archive, "okuri48:20-50", "--weight", "RFoot=2", "--json", "--top", 2
    )
    answer = json.loads(out)
    assert answer["query"] == {"take": "okuri48", "start": 20, "end": 50, "rate_hz": 30.0}
    assert answer["settings"] == {
        "part": "whole",
        "weights": {"RFoot": 2.0},
        "steps": "slope",
        "mirror": False,
        "path_weight": 0.0,
        "skip_doubtful": False,
        "threshold": None,
        "top": 2,
    }
    assert answer["matches"][0] == {
        "rank": 1,
        "take": "okuri48",
        "start": 20,
        "end": 50,
        "distance": 0.0,
        "mirrored": False,
        "level": "same",
        "chance": None,
    }
    assert list(answer["levels"]) == ["same", "like"]
    assert answer["clips"]["sampled"] < 50  # too few: no chance is told
    assert answer["searched"] == {"takes": 4, "frames": 326}
    assert answer["skipped"] == []
    assert answer["seconds"] > 0


def test_a_file_that_is_in_no_archive_is_a_query_like_its_take(archive, capsys, tmp_path):
    file = tmp_path / "inbox" / "okuri48.trc"
    _, of_take, _ = run(capsys, "search", archive, "okuri48:20-50", "--json")
    _, of_file, _ = run(capsys, "search", archive, f"{file}:20-50", "--json")
    matches = json.loads(of_file)["matches"]
    assert json.loads(of_file)["query"]["file"] == str(file)
    assert [m["take"] for m in matches] == [m["take"] for m in json.loads(of_take)["matches"]]
    assert matches[0]["distance"] < 1e-6


def test_the_index_changes_no_answer(archive, capsys):
    opened = open_archive(archive)
    takes = []
    for record in opened.records():
        motion = opened.take(record.take).motion
        position = motion["position"].values
        rows = pack_motion(position, record.rate_hz, motion.attrs["stature_m"])
        present = joints_present(position)
        takes.append(PackedTake(record.take, rows, record.rate_hz, record.frames, present))
    query = clip_take(takes[1], 20, 50)
    direct = search_takes(query, takes, SearchSettings(part="legs", mirror=True)).matches
    _, out, _ = run(
        capsys, "search", archive, "okuri48:20-50", "--part", "legs", "--mirror", "--json"
    )
    found = json.loads(out)["matches"]
    told = [{key: match[key] for key in ("rank", *asdict(direct[0]))} for match in found]
    assert [{"rank": i, **asdict(m)} for i, m in enumerate(direct, start=1)] == told
    assert len(found) > 3


def test_a_search_that_is_interrupted_says_what_it_found_until_then(archive, capsys, monkeypatch):
    found = [Match("okuri49", 3, 33, 0.01), Match("okuri48", 5, 40, 0.25)]

    def search(*_, **__):
        yield Found(found, {}, certain_below=0.1)
        raise KeyboardInterrupt

    monkeypatch.setattr(archive_search, "search_gradually", search)
    code, out, err = run(capsys, "search", archive, "okuri48:20-50")
    assert (code, out) == (INTERRUPTED, "")
    assert "stopped early; of the 2 matches until then 1 are certain:" in err
    assert "okuri49:3-33  0.0100" in err


def test_searching_some_takes_and_below_a_threshold(archive, capsys):
    _, out, _ = run(capsys, "search", archive, "okuri48:20-50", "--takes", "oku*9", "--json")
    assert {match["take"] for match in json.loads(out)["matches"]} == {"okuri49"}
    code, out, err = run(
        capsys, "search", archive, "okuri48:20-50", "--takes", "oku*9", "--threshold", "1e-9"
    )
    assert (code, out) == (0, "")
    assert "0 matches" in err


def test_a_threshold_may_be_a_level(archive, capsys):
    asked = ("search", archive, "okuri48:20-50", "--part", "feet", "--json")
    _, out, _ = run(capsys, *asked, "--threshold", "like")
    like = json.loads(out)
    reach = like["settings"]["threshold"]
    assert reach == like["levels"]["like"] > like["levels"]["same"]
    _, out, _ = run(capsys, *asked, "--threshold", reach)
    assert json.loads(out)["matches"] == like["matches"]
    assert {match["level"] for match in like["matches"]} <= {"same", "like"}
    _, out, _ = run(capsys, *asked, "--threshold", "same")
    assert [m for m in like["matches"] if m["level"] == "same"] == json.loads(out)["matches"]


@pytest.mark.parametrize("threshold", ["foo", "", "nan", "0", "-1", "SAME"])
def test_a_threshold_that_means_nothing_is_refused(archive, capsys, threshold):
    code, out, err = run(capsys, "search", archive, "okuri48", f"--threshold={threshold}")
    assert (code, out) == (2, "")
    assert f"the threshold is {threshold}" in err
    assert "give a distance above 0, same or like" in err


def test_levels_are_of_the_steps_that_they_were_measured_with(archive, capsys):
    asked = ("search", archive, "okuri48:20-50", "--steps", "paper")
    code, _, err = run(capsys, *asked, "--threshold", "same")
    assert code == 2
    assert "the threshold 'same' has no meaning with the steps 'paper'" in err
    _, out, _ = run(capsys, *asked, "--json")
    answer = json.loads(out)
    assert answer["levels"] == {}
    assert {match["level"] for match in answer["matches"]} == {None}


def test_a_search_pays_neither_for_prefect_nor_for_zarr(archive):
    program = (
        "import sys; from flows.command.main import main; code = main(sys.argv[1:]);"
        "slow = {'prefect', 'zarr', 'xarray', 'scipy.spatial', 'cv2'} & set(sys.modules);"
        "sys.exit(f'imported {slow}' if slow or code else 0)"
    )
    arguments = ("search", archive, "okuri48:20-50")
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("suffix", ["trc", "c3d", "csv", "bvh"])
def test_export_writes_what_its_suffix_says(archive, capsys, tmp_path, suffix):
    file = tmp_path / f"out.{suffix}"
    code, _, err = run(capsys, "export", archive, "okuri48", file, "--frames", "10-29")
    assert code == 0
    assert "20 frames at 30 Hz" in err
    position = open_archive(archive).take("okuri48").motion["position"].values[10:30]
    if suffix == "csv":
        table = np.genfromtxt(file, delimiter=",", names=True)
        assert len(table) == 20
        np.testing.assert_allclose(
            table["RFoot_z"], position[:, JOINTS.index("RFoot"), 2], atol=1e-5
        )
    elif suffix == "bvh":
        assert "bones of constant length follow the joints to" in err
        assert len(read_motion_file(file).position) == 20
    else:
        back = read_motion_file(file)
        order = [back.names.index(joint) for joint in JOINTS]
        np.testing.assert_allclose(back.position[:, order] * back.unit_m, position, atol=1e-5)


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


def test_a_take_without_search_array_is_said_and_the_others_are_searched(archive, capsys):
    take = open_archive(archive).take("radio")
    Path(archive, search_array_path("radio", take.record.version)).unlink()
    code, _, err = run(capsys, "search", archive, "okuri48:20-50")
    assert code == 0
    assert "not compared: radio: take 'radio' has no search array; run `shosa index`" in err


def test_garbage_is_listed_and_removed(archive, capsys):
    stray = Path(archive, "takes/radio/000009-deadbeef/zarr.json")
    stray.parent.mkdir()
    stray.write_text("{}")
    assert run(capsys, "gc", archive)[1] == ""
    code, out, err = run(capsys, "gc", archive, "--older-than", "0")
    assert (code, out) == (0, "takes/radio/000009-deadbeef/zarr.json\n")
    assert "removed 1 files" in err
    assert not stray.parent.exists()


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


def test_a_disk_that_fills_up_in_the_middle_leaves_nothing_half_written(small_disk, write_walk):
    file = write_walk(small_disk.parent / "long.trc", frames=3000)
    location = small_disk / "archive"
    [recording] = plan_takes(create_archive(location), [file]).recordings
    with pytest.raises(PlaceError, match="No space left on device; free some space"):
        import_take(str(location), recording, ImportSettings())
    assert not [path for path in (location / "takes").rglob("*") if path.is_file()]
    assert open_archive(location).takes() == []


def test_a_query_longer_than_every_take_finds_nothing_and_says_why(
    archive, capsys, tmp_path, write_walk
):
    long = write_walk(tmp_path / "long.trc", frames=400)
    code, out, err = run(capsys, "search", archive, long)
    assert (code, out) == (0, "")
    assert len(re.findall("^not compared: .*: it is too short", err, re.MULTILINE)) == 4
    assert "0 matches in 0 takes; searched 0 takes" in err


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


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp932", "utf-8"])
def test_a_terminal_without_the_letters_of_a_title_gets_their_numbers(
    archive, monkeypatch, encoding
):
    name = "所作é"
    [path] = Path(archive, "published", "okuri48").iterdir()
    fields = json.loads(path.read_text())
    del fields["sha256"]  # as a record of before
    path.write_text(json.dumps({**fields, "metadata": {"title": name, "performer": name}}))
    for command in ("takes", "show okuri48", "search okuri48:20-50", "path okuri48", "verify"):
        for as_json in ([], ["--json"]):
            words = command.split()
            if as_json and words[0] in ("path", "verify"):
                continue
            streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding) for _ in range(2)]
            monkeypatch.setattr(sys, "stdout", streams[0])
            monkeypatch.setattr(sys, "stderr", streams[1])
            code = main([words[0], archive, *words[1:], *as_json])
            for stream in streams:
                stream.flush()
            out, err = (stream.buffer.getvalue().decode(encoding) for stream in streams)
            assert code == (3 if command == "verify" else 0), err
            if as_json:
                assert name in json.dumps(json.loads(out), ensure_ascii=False) or "search" in words
            elif words[0] == "show":
                said = name.encode(encoding, "backslashreplace").decode(encoding)
                assert out.count(said) == 2


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


def test_frames_are_two_numbers_in_order():
    assert parse_frames("0-0") == (0, 0)
    for text in ("5", "5-", "9-5", "a-b", "-1-5"):
        with pytest.raises(ValueError, match="should be START-END"):
            parse_frames(text)


@pytest.mark.slow
def test_the_doctor_finds_this_installation_well(capsys):
    code, out, _ = run(capsys, "doctor")
    assert code == 0, out
    assert "the search kernel compiles and finds" in out
