"""The chain of stages without Prefect: what is computed anew, and the paper's method whole."""

import threading

import numpy as np
import pytest

from flows import chain
from storage import create_archive
from storage.blocks import read_block
from storage.formats.capture.capture import read_capture
from storage.places import delete_files, list_files
from storage.recordings import Recording, digest_capture
from storage.schema import SEGMENTS
from storage.upkeep.verification import verify_take
from tasks.body import paper_method
from tasks.capture import films as capture_films
from tasks.engine.compiling import read_list
from tasks.engine.fingerprints import fingerprint
from tasks.engine.progress import listening, report
from tasks.settings import Settings, read_settings
from tasks.takes.assembling import assemble_take
from tasks.takes.beginning import GivenUpError, begin_take, beginning_beside
from tasks.takes.publishing import publish_take
from tests.figures.posed_captures import film_posed
from tests.kernels import called_kernels

pytestmark = pytest.mark.slow

FRAMES = 12


@pytest.fixture(scope="module")
def posed(tmp_path_factory):
    """A capture that begins with the arms stretched, and its archive."""
    folder = tmp_path_factory.mktemp("films")
    capture = film_posed(folder / "posed", frames=FRAMES)
    source = read_capture(capture)
    recording = Recording(
        str(capture), digest_capture(capture), source.take, source.metadata, kind="capture"
    )
    return create_archive(folder / "archive"), recording


@pytest.fixture
def digitize(posed, monkeypatch):
    """Digitizes with some settings; returns the blocks and the stages that were computed."""
    archive, recording = posed
    monkeypatch.setattr(capture_films, "_BLOCK_FRAMES", 8)
    known = _KNOWN

    def run_all(tables=None):
        computed = []

        def run(function, **parameters):
            named = {key: value for key, value in parameters.items() if key != "capture"}
            key = fingerprint(function, named)
            if key not in known:
                # a block of other settings has another place, as those of other takes have
                into = parameters["into"].replace(".npz", f"-{len(known)}.npz")
                known[key] = function(**{**parameters, "into": into})
                computed.append(function.__name__)
            return known[key]

        settings = read_settings(tables or {}, "these").that_are_read()
        told = []
        with called_kernels() as called:
            blocks, _ = chain.digitize(
                archive.location, recording, settings, run=run,
                tell=lambda stage, end: told.append((stage, end)),
            )  # fmt: skip
        if not tables:  # what the usual settings call is compiled ahead
            listed = {k: v for kernels in read_list().values() for k, v in kernels.items()}
            assert called.items() <= listed.items(), "write the list anew: python -m tests.kernels"
        assert {stage for stage, _ in told} == set(blocks)
        return blocks, computed

    return run_all


_KNOWN: dict = {}

LABELS = ["label_block_provisionally"] * 2
AFTER_FIT = ["label_block"] * 2 + LABELS + ["track_take"]
AFTER_HULLS = ["color_block"] * 2 + ["model_take", "fit_take", *AFTER_FIT]


@pytest.mark.parametrize(
    ("tables", "computed"),
    [
        ({"provisional_labeling": {"volume_tolerance": 0.1}}, LABELS),
        ({"provisional_labeling": {"most_rings_of_paper": 7}}, []),
        ({"provisional_labeling": {"keep": False, "most_rings": 7}}, []),
        ({"pose_fitting": {"paper": {"rounds": 2}}}, []),
        ({"joint_tracks": {"radius": 0.06}}, ["track_take"]),
        ({"pose_fitting": {"doubts": {"hidden_s": 0.2}}}, ["fit_take", *AFTER_FIT]),
        ({"agreement": {"margin_m": 0.2}}, []),
    ],
    ids=lambda value: next(iter(value), "nothing") if isinstance(value, dict) else None,
)
def test_a_setting_computes_what_reads_it_anew_and_nothing_else(digitize, tables, computed):
    """What comes after is computed only where what came before is another."""
    digitize()
    _, again = digitize(tables)
    assert again == computed
    assert digitize(tables)[1] == []


def test_two_blocks_are_worked_on_at_a_time_and_come_in_order():
    """Those after the first meet in pairs, so that one alone would wait for ever."""
    meeting, at_work, most = threading.Barrier(2), [], []

    def work(n):
        at_work.append(n)
        most.append(len(at_work))
        if n:
            meeting.wait(30.0)
        at_work.remove(n)
        return n

    def run(function, **parameters):
        report(1, 2)
        return function(**parameters)

    heard = []
    with listening(heard.append, every_s=0.0):
        done = list(chain._run_ahead(run, work, [{"n": n} for n in range(5)]))
    assert done == [0, 1, 2, 3, 4]
    assert max(most) == 2
    assert heard == [0.5], "only the first block is heard of"


def test_a_take_without_provisional_labels_is_whole(posed, digitize):
    archive, recording = posed
    usual, _ = digitize()
    blocks, _ = digitize({"provisional_labeling": {"keep": False}})
    assert usual.keys() - blocks.keys() == {"provisional_labeling"}
    draft = assemble_take(
        archive.location, recording.path, recording.digest, "without", blocks,
        settings={}, changed={}, code="", notes=[],
    )  # fmt: skip
    publish_take(archive.location, draft, over=0)
    assert verify_take(archive.place, "without") == []
    frame = archive.take("without").voxels(FRAMES - 1)
    assert len(np.unique(frame.label)) == len(SEGMENTS)
    assert "provisional_label" not in frame


def test_a_version_that_was_begun_beside_the_poses_is_the_one_that_is_written_at_once(
    posed, digitize
):
    archive, recording = posed
    blocks, _ = digitize()
    named = (archive.location, recording.path, recording.digest, "begun")
    with beginning_beside(*named, {}) as begin:
        early = begin({stage: blocks[stage] for stage in ("silhouettes", "carving", "coloring")})
        assert begin(blocks) is early
        rest = {"settings": {}, "changed": {}, "code": "", "notes": []}
        drafts = [
            assemble_take(*named, blocks, **rest, begun=early.result()),
            assemble_take(*named, blocks, **rest),
        ]
    assert drafts[0]["version"] == early.result().version != drafts[1]["version"]
    written = [
        {name: file for name, file in draft["files"].items() if "/c/" in name} for draft in drafts
    ]
    assert written[0] == written[1]
    assert {name.split("/c/")[0] for name in written[0]} >= {"voxels/label", "voxels/color"}
    assert drafts[0]["files"].keys() == drafts[1]["files"].keys()


def test_a_version_of_which_something_was_removed_meanwhile_is_written_anew(posed, digitize):
    archive, recording = posed
    blocks, _ = digitize()
    named = (archive.location, recording.path, recording.digest, "removed")
    begun = begin_take(*named, blocks, {})
    delete_files(archive.place, [sorted(begun.files)[len(begun.files) // 2]])
    rest = {"settings": {}, "changed": {}, "code": "", "notes": []}
    draft = assemble_take(*named, blocks, **rest, begun=begun)
    assert draft["version"] != begun.version
    publish_take(archive.location, draft, over=0)
    assert verify_take(archive.place, "removed") == []


@pytest.mark.parametrize("begun", [False, True], ids=["not begun", "begun"])
def test_nothing_is_left_of_a_version_whose_poses_failed(posed, digitize, begun):
    archive, recording = posed
    blocks, _ = digitize()
    named = (archive.location, recording.path, recording.digest, "failed")

    def fail():
        with beginning_beside(*named, {}) as begin:
            if begun:
                begin(blocks)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list_files(archive.place, "takes/failed") == []


def test_a_version_that_is_given_up_is_not_written_to_its_end(posed, digitize):
    archive, recording = posed
    blocks, _ = digitize()
    given_up = threading.Event()
    given_up.set()
    with pytest.raises(GivenUpError, match="not wanted"):
        begin_take(
            archive.location, recording.path, recording.digest, "given-up", blocks, {},
            given_up=given_up,
        )  # fmt: skip
    assert list_files(archive.place, "takes/given-up") == []


def test_another_rule_of_silhouettes_is_another_take_altogether(digitize):
    usual, _ = digitize()
    other, computed = digitize({"silhouettes": {"rule": "crcb"}})
    assert computed[:2] == ["extract_block"] * 2
    assert "fit_take" in computed
    assert other["silhouettes"][0].block.sha256 != usual["silhouettes"][0].block.sha256


def test_what_is_stored_by_the_paper_is_what_its_pose_was_fitted_to(posed, digitize, monkeypatch):
    """Provisional labels of every frame after the first, and the placed labels of the first."""
    place, fitted_to = posed[0].place, []
    fit = paper_method.fit_frame_as_paper

    def fit_and_remember(center, label, *rest, **more):
        fitted_to.append(label.copy())
        return fit(center, label, *rest, **more)

    monkeypatch.setattr(paper_method, "fit_frame_as_paper", fit_and_remember)
    blocks, computed = digitize({"pose_fitting": {"method": "paper"}})
    assert computed == ["fit_take", *AFTER_FIT]
    [model] = blocks["initial_model"]
    first = model.block.start
    assert len(fitted_to) == FRAMES - first - 1
    final, provisional = [], []
    for each, before in zip(blocks["final_labeling"], blocks["provisional_labeling"], strict=True):
        read = read_block(place, each.block)
        labels = read_block(place, before.block)["provisional_label"]
        for begin, end in zip(read["offset"], read["offset"][1:], strict=False):
            final.append(read["label"][begin:end])
            provisional.append(labels[begin:end])
    for frame, label in enumerate(fitted_to, first + 1):
        np.testing.assert_array_equal(provisional[frame], label)
    np.testing.assert_array_equal(final[first], read_block(place, model.block)["label"])
    assert any((a != b).any() for a, b in zip(final, provisional, strict=True))


def test_the_papers_own_number_of_rings_reaches_its_fit(digitize):
    usual, _ = digitize({"pose_fitting": {"method": "paper"}})
    few, computed = digitize(
        {"pose_fitting": {"method": "paper"}, "provisional_labeling": {"most_rings_of_paper": 0}}
    )
    assert computed[0] == "fit_take"
    assert few["provisional_labeling"][1].block.sha256 != (
        usual["provisional_labeling"][1].block.sha256
    )
    _, computed = digitize(
        {"pose_fitting": {"method": "paper"}, "provisional_labeling": {"most_rings": 3}}
    )
    assert computed == []


def test_one_stature_serves_every_stage(digitize, posed):
    blocks, _ = digitize()
    [model] = blocks["initial_model"]
    stature_m = float(read_block(posed[0].place, model.block)["stature_m"])
    assert 1.2 < stature_m < 2.0
    assert Settings().provisional_labeling.reach_m(stature_m, 30.0) == pytest.approx(
        5.0 * stature_m / 30.0
    )
