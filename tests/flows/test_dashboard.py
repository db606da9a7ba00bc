"""What the dashboard shows is true, is only letters, and can harm no run."""

import dataclasses
import logging
import re

import pytest

from flows import dashboard
from flows.dashboard import (
    count_teller,
    ingested_rows,
    match_rows,
    progress_teller,
    show_digitized,
    shown,
)
from flows.links import VIEWER_URL, artifact_key, viewer_url
from flows.progress import ASSEMBLING
from storage import create_archive, open_archive
from storage.archive import Take
from storage.records import Record
from tasks.retrieval.answering import Answer
from tasks.retrieval.searching import Match, SearchSettings
from tests.figures.archives.digitized_takes import write_digitized
from tests.figures.posed_captures import film_posed

HOSTILE = "<script>alert(1)</script> | **b** [x](javascript:alert(1))\nnext"


@pytest.fixture(autouse=True)
def no_memory(monkeypatch):
    """No test knows of a server that went away in another."""
    monkeypatch.setattr("flows.artifacts._AWAY", {})


@pytest.fixture
def said(monkeypatch):
    """What the modules of the dashboard log, each as (level, text)."""
    records = []
    handler = logging.Handler()
    handler.emit = lambda record: records.append((record.levelname, record.getMessage()))
    loggers = [logging.getLogger(f"flows.{name}") for name in ("artifacts", "dashboard")]
    for logger in loggers:
        logger.addHandler(handler)
        monkeypatch.setattr(logger, "propagate", False)
    yield records
    for logger in loggers:
        logger.removeHandler(handler)


@pytest.fixture
def artifacts(monkeypatch):
    """What would be sent to a server: the last state of each artifact, and every update."""
    sent, updates = [], []

    def create(**fields):
        sent.append(fields)
        return len(sent)

    def update(artifact_id, **fields):
        sent[artifact_id - 1] |= fields
        updates.append(fields)

    for name in ("progress", "markdown", "table"):
        monkeypatch.setattr(dashboard, f"create_{name}_artifact", create)
    monkeypatch.setattr(dashboard, "update_progress_artifact", update)
    return sent, updates


@pytest.mark.parametrize(
    ("name", "key"), [("okuri48", "digitized-okuri48"), ("a-b", "digitized-a-b")]
)
def test_a_plain_name_is_its_own_key(name, key):
    assert artifact_key("digitized", name) == key


def test_every_other_name_has_a_key_of_its_own_that_stays():
    names = [
        "送り",
        "送り2",
        "okuri_48",
        "Okuri_48",
        "okuri-48",
        "a" * 300,
        "a" * 301,
        "-a",
        "",
        "é",
    ]
    keys = [artifact_key("digitized", name) for name in names]
    assert len(set(keys)) == len(names)
    assert all(re.fullmatch(r"digitized(-[a-z0-9]+)*", key) for key in keys)
    assert max(map(len, keys)) < 90
    assert artifact_key("digitized", "送り") == "digitized-f56a0897"


def outcome(status, take="okuri", **fields):
    usual = {"path": f"/in/{take}.bvh", "frames": 0, "rate_hz": 0.0, "joints": 0, "notes": []}
    return {"status": status, "take": take, "reason": "", **usual, **fields}


def test_what_failed_or_was_refused_comes_first():
    order = ["unchanged", "ingested", "refused", "strange", "failed", "refused"]
    rows = ingested_rows([outcome(each, take=f"take{n}") for n, each in enumerate(order)])
    assert [row["status"] for row in rows] == [
        "strange", "failed", "refused", "refused", "ingested", "unchanged",
    ]  # fmt: skip
    assert [row["take"] for row in rows if row["status"] == "refused"] == ["take2", "take5"]
    assert list(rows[0])[:3] == ["status", "take", "reason"]


def test_a_row_says_what_and_why_in_letters_only():
    refused = outcome("refused", "broken", reason=f"/in/broken.bvh: {HOSTILE}")
    [row] = ingested_rows([refused])
    assert row["reason"].startswith("broken.bvh: &lt;script&gt;")
    assert "\n" not in row["reason"]
    assert not re.search(r"(?<!\\)\]\(", row["reason"])
    assert (row["frames"], row["Hz"], row["joints"]) == ("", "", "")
    [row] = ingested_rows(
        [outcome("ingested", frames=90, rate_hz=29.97, joints=19, notes=["a", "b"])]
    )
    assert (row["frames"], row["Hz"], row["joints"], row["notes"]) == (90, "29.97", 19, "a; b")


@pytest.fixture
def answer():
    def record(take, title):
        source = {"kind": "bvh", "name": "a", "path": "a", "digest": "d"}
        return Record(take, "1", 1, source, {"title": title}, 900, 30.0, [], ["motion"], {})

    records = {"salsa_01": record("salsa_01", HOSTILE), "送り": record("送り", "Okuri")}
    matches = [Match("salsa_01", 30, 90, 0.0312), Match("送り", 600, 660, 0.25, mirrored=True)]
    asked = {"take": "送り", "start": 20, "end": 80, "rate_hz": 30.0}
    settings = SearchSettings(part="arms", mirror=True, threshold=0.5)
    return Answer(asked, settings, matches, records, {}, 2, 1800, 0.1)


def test_matches_are_a_table_without_links_where_no_viewer_is_known(answer):
    first, second = match_rows(answer, None)
    assert (first["rank"], first["take"], first["frames"]) == ("1", "salsa_01", "30-90")
    assert (first["seconds"], first["distance"], first["mirrored"]) == ("1.00-3.00", "0.0312", "")
    assert (second["mirrored"], second["title"]) == ("yes", "Okuri")
    assert [(row["level"], row["by chance"]) for row in (first, second)] == [
        ("same", "?"),
        ("", "?"),
    ]
    assert "<" not in first["title"]
    assert not re.search(r"(?<!\\)\]\(", first["title"])


def test_a_column_that_would_be_empty_is_left_out(answer):
    plain = dataclasses.replace(answer, matches=answer.matches[:1])
    assert "mirrored" not in match_rows(plain, None)[0]


def test_matches_lead_to_the_clip_and_to_the_comparison(answer):
    viewer = "http://127.0.0.1:8080"
    _, row = match_rows(answer, viewer)
    assert row["take"] == f"[送り]({viewer}/?take=%E9%80%81%E3%82%8A&clip=600-660)"
    assert row["rank"] == (
        f"[2]({viewer}/?take=%E9%80%81%E3%82%8A&clip=20-80&part=arms&top=10&threshold=0.5"
        "&mirror=yes&match=2&search=yes)"
    )


def test_a_search_that_an_address_cannot_say_has_no_link_to_a_comparison(answer):
    file = {"file": "/in/a.bvh", "start": 0, "end": 9, "rate_hz": 30.0}
    other = dataclasses.replace(answer, query=file)
    assert match_rows(other, "http://viewer")[0]["rank"] == "1"


@pytest.mark.parametrize(
    ("given", "url"),
    [
        ("http://127.0.0.1:8080", "http://127.0.0.1:8080"),
        (" https://lab.example/view ", "https://lab.example/view"),
        ("javascript:alert(1)", None),
        ("lab:8080", None),
        ("", None),
    ],
)
def test_only_an_address_of_the_web_is_a_viewer(monkeypatch, given, url):
    monkeypatch.setenv(VIEWER_URL, given)
    assert viewer_url() == url


def test_a_server_that_fails_is_told_of_once_and_left_alone_for_a_while(monkeypatch, said):
    calls, now = [], [0.0]
    monkeypatch.setattr(dashboard.time, "monotonic", lambda: now[0])

    def refuse(**arguments):
        calls.append(arguments)
        raise ConnectionError("all connection\n attempts failed")

    for second in (0, 1, 59, 61, 62, 200):
        now[0] = float(second)
        assert shown(refuse, key="a") is None
    assert len(calls) == 3  # at 0, 61 and 200 s
    [(level, text)] = said
    assert level == "WARNING"
    assert "(all connection attempts failed); the run goes on without" in text
    now[0] = 300.0
    assert shown(lambda **arguments: arguments, key="b") == {"key": "b"}


def test_progress_goes_forward_to_its_end_and_says_what_is_done(monkeypatch, artifacts, said):
    now = [0.0]
    monkeypatch.setattr(dashboard.time, "monotonic", lambda: now[0])
    tell = progress_teller("okuri", 300)
    for stage in ("silhouettes", "carving", "coloring", "initial_model", "pose_fitting"):
        for frame in (0, 75.5, 150, 225.0, 300):
            now[0] += 4.0
            tell(stage, frame)
    tell(ASSEMBLING, 0)
    tell(ASSEMBLING, 300)
    [sent], updates = artifacts
    shares = [each["progress"] for each in updates]
    assert shares == sorted(shares)
    assert (sent["progress"], sent["description"]) == (100.0, "done: okuri")
    assert all(
        re.match(r"\d+%(, .* left)?: okuri, \w+", each["description"]) for each in updates[:-1]
    )
    lines = [text for _, text in said]
    assert sum("silhouettes" in line for line in lines) >= 2  # its blocks at least
    assert any(re.search(r"pose fitting 300/300 frames, .+ left", t) for t in lines)


def test_progress_is_not_sent_more_often_than_it_is_read(monkeypatch, artifacts):
    monkeypatch.setattr(dashboard.time, "monotonic", lambda: 5.0)
    tell = progress_teller("okuri", 300)
    for frame in range(300):
        tell("silhouettes", frame / 2)
    assert artifacts[1] == []


def test_takes_of_a_run_are_counted(artifacts):
    tell = count_teller("3 recordings into a", 3)
    for done in (1, 2, 3):
        tell(done)
    [sent], _ = artifacts
    assert (sent["progress"], sent["description"]) == (100.0, "done: 3 recordings into a")


def test_the_page_of_a_take_is_shown_under_its_key(artifacts, tmp_path):
    place = create_archive(tmp_path / "archive").place
    take = Take(place, write_digitized(place, "送り", doubtful=[3]))
    show_digitized(take, {})
    [[sent], _] = artifacts
    assert sent["key"] == artifact_key("digitized", "送り")
    assert sent["description"] == "送り: 12 frames at 10 Hz, 1 of them doubtful"
    assert sent["markdown"].startswith("# 送り\n\n**In the archive")


def test_a_page_that_cannot_be_made_harms_nothing(artifacts, said, tmp_path):
    place = create_archive(tmp_path / "archive").place
    take = Take(place, write_digitized(place, "okuri"))
    (place.folder / take.folder / "voxels" / "zarr.json").unlink()
    show_digitized(take, {})
    assert artifacts[0] == []
    [(level, text)] = said
    assert level == "WARNING"
    assert text.startswith("okuri: its page cannot be made: ")


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Films of a body that begins with the arms stretched, so that it gets a pose."""
    return film_posed(tmp_path_factory.mktemp("films") / "posed")


@pytest.mark.flow
@pytest.mark.slow
@pytest.mark.usefixtures("prefect_server")
def test_a_digitization_is_on_the_dashboard_and_in_its_log(capture, tmp_path):
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.sorting import ArtifactSort, LogSort

    from flows.ingestion import ingest_archive

    archive = str(tmp_path / "dashed")
    ingest_archive(archive, [str(capture)])
    with get_client(sync_client=True) as client:
        found = client.read_artifacts(limit=100, sort=ArtifactSort.CREATED_DESC)
        logs = client.read_logs(limit=200, sort=LogSort.TIMESTAMP_DESC)
    mine = [each for each in found if re.search("dashed|posed", f"{each.data}{each.description}")]
    kinds = {each.type: each for each in mine}
    assert set(kinds) == {"progress", "markdown", "table"}
    assert kinds["markdown"].key == "digitized-posed"
    assert "12 frames at 30 Hz" in kinds["markdown"].data
    progresses = {each.description: each.data for each in mine if each.type == "progress"}
    assert progresses["done: posed"] == 100.0
    texts = {each.message.strip() for each in logs}
    assert any(text.startswith("posed: pose fitting 12/12 frames") for text in texts)
    assert any(text.startswith("fitted 12 frames") for text in texts)  # of the stages, too


@pytest.mark.flow
@pytest.mark.slow
@pytest.mark.usefixtures("prefect_server")
def test_a_server_that_takes_no_artifact_harms_no_take(capture, tmp_path, monkeypatch, said):
    from prefect.client.orchestration import SyncPrefectClient

    from flows.ingestion import ingest_archive

    def refuse(*_, **__):
        raise ConnectionError("refused")

    monkeypatch.setattr(SyncPrefectClient, "create_artifact", refuse)
    monkeypatch.setattr(SyncPrefectClient, "update_artifact", refuse)
    ingest_archive(str(tmp_path / "archive"), [str(capture)])
    take = open_archive(tmp_path / "archive").take("posed")
    assert "motion" in take.record.stages
    warnings = [text for level, text in said if level == "WARNING"]
    assert len(warnings) == 2  # one a run: of the ingestion, and of the digitization
    assert all("the run goes on without" in text for text in warnings)
