"""The command line: every sub-command tells what it does, and shows and writes takes."""

import io
import json
import re
import sys
import tomllib
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from flows.command.main import build_parser, main
from storage import open_archive
from storage.formats import read_motion_file
from storage.schema import JOINTS
from tests.flows.command.conftest import run

COMMANDS = (
    *("demo", "ingest", "serve", "plan", "render", "takes", "show", "path", "search", "index"),
    *("view", "report", "export", "calibrate", "verify", "gc", "doctor", "settings"),
)


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
