"""Tests of the file of ratios that `make bench` keeps."""

import json

from tests.benchmarks.history import keep_ratios, last_release


def test_ratios_stand_beside_those_of_the_last_release_and_before_one_of_the_first_run(
    tmp_path, capsys
):
    history = tmp_path / "history.jsonl"
    keep_ratios("carving", {"plain loops": 21.0}, history)
    assert "nan" in capsys.readouterr().out
    keep_ratios("carving", {"plain loops": 19.0}, history)
    keep_ratios("search", {"plain loops": 5.0}, history)
    [_, beside] = [line.split() for line in capsys.readouterr().out.splitlines() if "plain" in line]
    assert beside[-1] == "nan"  # of another benchmark
    lines = [json.loads(line) for line in history.read_text().splitlines()]
    assert [line["ratios"] for line in lines] == [{"plain loops": n} for n in (21.0, 19.0, 5.0)]
    assert last_release("carving", history) == lines[0]
    released = {**lines[1], "release": "v1.0.0"}
    history.write_text("\n".join(map(json.dumps, [lines[0], released, lines[1]])) + "\n")
    assert last_release("carving", history) == released
    keep_ratios("carving", {"plain loops": 20.0}, history)
    assert "19.00  " not in capsys.readouterr().out.splitlines()[-1]
    assert last_release("nothing", history) is None
