"""A table of matches says what the answer to the same query says."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from storage import open_archive
from storage.errors import InputError, UnknownNameError
from tasks.retrieval.answering import answer_query, find_matches
from tasks.retrieval.searching import SearchSettings
from tests.figures.archives.imported import take_in_plainly


@pytest.fixture
def archive(tmp_path, write_walk):
    """Three takes, of which one says who dances, and one is too short for some queries."""
    folder = tmp_path / "inbox"
    for number, (name, frames) in enumerate({"okuri48": 80, "okuri49": 81, "brief": 9}.items()):
        write_walk(folder / f"{name}.trc", seed=number, frames=frames)
    (folder / "okuri48.toml").write_text('[take]\ntitle = "Okuri 48"\nperformer = "TK"\n')
    return take_in_plainly(tmp_path / "archive", folder)


@pytest.mark.parametrize(
    ("options", "settings", "takes"),
    [
        ({}, SearchSettings(), None),
        ({"part": "arms", "top": 2}, SearchSettings(part="arms", top=2), None),
        ({"weights": {"RFoot": 2.0, "Head": 0.0}}, None, None),
        ({"mirror": True, "path_weight": 0.2}, SearchSettings(mirror=True, path_weight=0.2), None),
        ({"steps": "paper", "threshold": 0.1}, SearchSettings(steps="paper", threshold=0.1), None),
        ({"takes": "okuri49"}, SearchSettings(), "okuri49"),
    ],
    ids=["whole", "arms", "weights", "mirror", "paper", "takes"],
)
def test_the_table_has_the_matches_of_the_answer(archive, options, settings, takes):
    settings = settings or SearchSettings(weights=(("RFoot", 2.0), ("Head", 0.0)))
    table = find_matches(archive, "okuri48:20-50", **options)
    answer = answer_query(str(archive), "okuri48:20-50", settings, takes)
    rows = table.drop(columns=["performer", "title", "level", "chance"]).to_dict("records")
    expected = [{"rank": rank, **asdict(m)} for rank, m in enumerate(answer.matches, start=1)]
    assert rows == expected
    assert rows
    assert table.attrs["skipped"] == answer.skipped
    assert list(table["level"]) == [answer.meaning(match)["level"] for match in answer.matches]
    assert table["chance"].isna().all()  # three short takes are too few


def test_what_is_told_on_the_way_ends_with_the_answer_and_what_is_certain_stays(archive):
    told = []
    answer = answer_query(
        str(archive), "okuri48:20-50", SearchSettings(),
        tell=lambda matches, certain: told.append((matches, certain)),
    )  # fmt: skip
    assert told[-1] == (answer.matches, len(answer.matches))
    for matches, certain in told:
        assert matches[:certain] == answer.matches[:certain]


def test_an_open_archive_a_path_and_a_text_are_the_same_archive(archive):
    tables = [
        find_matches(each, "okuri48:20-50")
        for each in (open_archive(archive), Path(archive), archive)
    ]
    assert tables[0].equals(tables[1])
    assert tables[0].equals(tables[2])


def test_the_table_says_who_danced_what_and_what_was_not_compared(archive):
    table = find_matches(archive, "okuri48:0-60")
    of = {take: set(rows["performer"]) for take, rows in table.groupby("take")}
    assert of == {"okuri48": {"TK"}, "okuri49": {None}}
    assert set(table.loc[table["take"] == "okuri48", "title"]) == {"Okuri 48"}
    assert "too short" in table.attrs["skipped"]["brief"]


def test_a_level_is_a_threshold(archive):
    near = find_matches(archive, "okuri48:20-50", threshold="like")
    every = find_matches(archive, "okuri48:20-50")
    assert len(near) == every["level"].notna().sum() > 0


def test_a_table_without_matches_has_the_same_columns_and_kinds(archive):
    empty = find_matches(archive, "okuri48:20-50", takes="okuri49", threshold=1e-9)
    some = find_matches(archive, "okuri48:20-50")
    assert len(empty) == 0
    assert list(empty.columns) == [
        *("rank", "take", "start", "end", "distance", "mirrored", "level", "chance"),
        *("performer", "title"),
    ]
    assert empty.dtypes.equals(some.dtypes)
    assert some["distance"].dtype == np.float64
    assert some["mirrored"].dtype == bool


def test_what_cannot_be_asked_is_refused_as_on_the_command_line(archive, tmp_path):
    with pytest.raises(UnknownNameError, match="no take 'okuri47'"):
        find_matches(archive, "okuri47")
    with pytest.raises(ValueError, match="no part 'foot'; did you mean feet"):
        find_matches(archive, "okuri48", part="foot")
    with pytest.raises(ValueError, match="the threshold is near; give a distance above 0, same or"):
        find_matches(archive, "okuri48", threshold="near")
    with pytest.raises(InputError, match=r"is not an archive: it has no archive\.json"):
        find_matches(Path(tmp_path / "inbox"), "okuri48")
