"""The command `search`: what it prints, what it is asked with, and what it pays for."""

import json
import re
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from flows.command.exits import INTERRUPTED
from storage import open_archive
from storage.arrays.search import search_array_path
from tasks.motion.stature import joints_present
from tasks.retrieval import archive_search
from tasks.retrieval.normalization import pack_motion
from tasks.retrieval.searching import Found, Match, SearchSettings, clip_take, search_takes
from tasks.retrieval.segments import PackedTake
from tests.flows.command.conftest import run


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


def test_a_query_longer_than_every_take_finds_nothing_and_says_why(
    archive, capsys, tmp_path, write_walk
):
    long = write_walk(tmp_path / "long.trc", frames=400)
    code, out, err = run(capsys, "search", archive, long)
    assert (code, out) == (0, "")
    assert len(re.findall("^not compared: .*: it is too short", err, re.MULTILINE)) == 4
    assert "0 matches in 0 takes; searched 0 takes" in err


def test_a_take_without_search_array_is_said_and_the_others_are_searched(archive, capsys):
    take = open_archive(archive).take("radio")
    Path(archive, search_array_path("radio", take.record.version)).unlink()
    code, _, err = run(capsys, "search", archive, "okuri48:20-50")
    assert code == 0
    assert "not compared: radio: take 'radio' has no search array; run `shosa index`" in err


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
