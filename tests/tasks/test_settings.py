"""Settings by their names, from a file; what is refused, and with which words."""

import tomllib
from dataclasses import replace

import pytest

from storage.errors import InputError
from storage.formats.settings_toml import read_capture_settings, read_settings_tables
from tasks.settings import (
    Settings,
    all_settings,
    changed_settings,
    format_settings,
    merge_tables,
    read_settings,
)


def test_what_is_printed_is_read_again_as_the_defaults():
    tables = tomllib.loads("\n".join(format_settings()))
    assert read_settings(tables, "f.toml") == Settings()
    assert changed_settings(read_settings(tables, "f.toml")) == {}


def test_every_setting_that_is_printed_can_be_set():
    """Another value in its range reaches the settings and is told; so none is out of reach."""
    reached = 0
    for each in all_settings():
        for value in _others(each.value, each.accepted):
            tables = value
            for name in reversed(each.name.split(".")):
                tables = {name: tables}
            try:
                read = read_settings(tables, "f.toml")
            except InputError:  # out of its range, or together with others
                continue
            assert changed_settings(read) == {each.name: value}
            reached += 1
            break
        else:
            pytest.fail(f"{each.name} = {each.value!r} cannot be set to anything else")
    assert reached > 130


def _others(value, accepted):
    if isinstance(value, bool):
        return [not value]
    if accepted == "a text":
        return ["#00b140"]
    if isinstance(value, str):
        return [word for word in accepted.replace('"', "").split(" ", 2)[2].split(", ")
                if word != value]  # fmt: skip
    if isinstance(value, int):
        return [value + 1, value - 1]
    return [other for other in (value * 0.9, value * 1.1, value + 0.1) if other != value]


def test_every_setting_says_what_it_means_why_and_in_which_unit():
    silent = [each.name for each in all_settings() if not (each.meaning and each.reason)]
    assert silent == []
    unitless = [
        each.name for each in all_settings() if isinstance(each.value, float) and not each.unit
    ]
    assert unitless == []


def test_all_faults_are_told_at_once_with_the_nearest_name_and_the_range():
    tables = {
        "pose_fiting": {},
        "carving": 3,
        "silhouettes": {"treshold": 1.0, "rule": "hue", "threshold": float("nan")},
        "coloring": {"normal_reach": "wide"},
        "pose_fitting": {"method": "papre", "paper": {"rounds": 1.5}},
    }
    with pytest.raises(InputError, match=r"^f\.toml cannot be used") as refused:
        read_settings(tables, "f.toml")
    said = str(refused.value)
    for part in (
        "no stage 'pose_fiting'; pose_fitting is meant?",
        "carving is a table",
        "no setting 'silhouettes.treshold'; silhouettes.threshold is meant?",
        'silhouettes.rule = \'hue\' should be one of "chroma", "crcb"',
        "silhouettes.threshold = nan should be a number",
        'pose_fitting.method = \'papre\' should be one of "joint", "paper"',
        "pose_fitting.paper.rounds = 1.5 should be a whole number",
    ):
        assert part in said, part


def test_of_two_files_the_one_above_wins_and_what_both_set_is_told():
    below = {"carving": {"min_cameras": 3, "misses_allowed": 1}, "coloring": {}}
    above = {
        "carving": {"min_cameras": 4, "misses_allowed": 1},
        "pose_fitting": {"method": "paper"},
    }
    merged, both = merge_tables(below, above)
    assert merged["carving"] == {"min_cameras": 4, "misses_allowed": 1}
    assert merged["pose_fitting"] == {"method": "paper"}
    assert both == ["carving.min_cameras"]
    assert below["carving"]["min_cameras"] == 3


def test_settings_that_the_method_does_not_read_do_not_count():
    usual = Settings().that_are_read()
    paper = read_settings({"pose_fitting": {"paper": {"rounds": 2}}}, "f")
    assert paper.that_are_read() == usual
    rings = read_settings({"provisional_labeling": {"most_rings_of_paper": 7}}, "f")
    assert rings.that_are_read() == usual
    by_paper = read_settings({"pose_fitting": {"method": "paper", "paper": {"rounds": 2}}}, "f")
    assert by_paper.that_are_read().pose_fitting.paper.rounds == 2
    assert replace(by_paper, provisional_labeling=rings.provisional_labeling).for_labels(
    ).most_rings == 7  # fmt: skip


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"[carving\n", "is no TOML"),
        (b"a = \xff\n", "is not in UTF-8"),
        (b"", "is empty"),
        (b"#" * (1 << 21), "is longer than"),
    ],
    ids=["no toml", "no utf-8", "empty", "long"],
)
def test_a_file_that_is_no_settings_is_refused(tmp_path, content, why):
    path = tmp_path / "my.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"my\.toml {why}"):
        read_settings_tables(path)


def test_a_file_that_is_not_there_or_is_a_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml cannot be read"):
        read_settings_tables(tmp_path / "none.toml")
    with pytest.raises(InputError, match="is no regular file"):
        read_settings_tables(tmp_path)


def test_a_byte_order_mark_is_no_fault_and_a_capture_needs_no_file(tmp_path):
    assert read_capture_settings(tmp_path) == {}
    (tmp_path / "digitize.toml").write_bytes(b"\xef\xbb\xbf[carving]\nmin_cameras = 4\n")
    assert read_capture_settings(tmp_path) == {"carving": {"min_cameras": 4}}
