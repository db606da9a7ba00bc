"""What is sent to a page: packed tracks and voxels, who may ask, and what an address means."""

import gzip
import re
import struct
import subprocess
import sys
import time

import numpy as np
import pytest

from storage.schema import JOINTS
from tests.conftest import HANGING_S, swaying_body
from tests.figures.archives.dances import ORIGIN_M, SHAPE, VOXEL_M, box, make_dances
from viewer.addresses.frames import _track, _voxels
from viewer.asking import Asking, read_address
from viewer.digitizing import Digitizations
from viewer.guard import is_own_host
from viewer.holdings import Holdings, matching
from viewer.pairing import strip_path
from viewer.texts import _TEXTS, choose_language
from viewer.tracks import LOST, make_palette, pack_track


def read_track(content):
    """Positions (row, joint, 3) of a pack, read number by number as the page does."""
    magic, _, joints, rows, first, step, scale, x, y, z = struct.unpack_from(
        "<4sHHIIIffff", content
    )
    assert magic == b"SHTR"
    found = np.empty((rows, joints, 3))
    for k in range(joints * 3):
        total = 0
        for row in range(rows):
            (ahead,) = struct.unpack_from("<h", content, 36 + 2 * (k * rows + row))
            total = (total + ahead + 32768) % 65536 - 32768
            value = np.nan if total == LOST else total * scale + (x, y, z)[k % 3]
            found[row, k // 3, k % 3] = value
    return found, first, step


def read_voxels(content, frames):
    """Number, palette place and label of each voxel of each frame of a pack, read byte by byte."""
    colors = struct.unpack_from("<H", content, 6)[0]
    palette = np.frombuffer(content, np.uint8, 3 * colors, 52).reshape(-1, 3)
    at, found = 52 + 3 * colors, []
    for _ in range(frames):
        frame, count, wide, _ = struct.unpack_from("<IIII", content, at)
        far = struct.unpack_from(f"<{wide}I", content, at + 16)
        at += 16 + 4 * wide
        number, numbers, left = 0, [], list(far)
        for ahead in content[at : at + count]:
            number += left.pop(0) if ahead == 255 else ahead
            numbers.append(number)
        places, labels = (
            content[at + count : at + 2 * count],
            content[at + 2 * count : at + 3 * count],
        )
        found.append((frame, numbers, palette[list(places)], list(labels)))
        at += 3 * count
    assert at == len(content)
    return found


def test_a_track_comes_back_to_a_tenth_of_a_millimeter():
    position = swaying_body(3, 50).astype(np.float32)
    position[10:20, 4] = np.nan
    position[:, 7, 1] = np.inf  # a joint is there with all three or not at all
    position[:, 0, 0] += np.linspace(0, 6, 50)
    found, first, step = read_track(pack_track(position, 100, 3))
    assert (first, step) == (100, 3)
    there = np.isfinite(position).all(axis=2)
    np.testing.assert_array_equal(np.isfinite(found).all(axis=2), there)
    assert np.abs(found - position)[there].max() < 1.1e-4


@pytest.mark.parametrize("frames", [1, 2])
def test_a_track_without_joints_comes_back_without(frames):
    found, _, _ = read_track(pack_track(np.full((frames, 21, 3), np.nan), 0, 1))
    assert np.isnan(found).all()


@pytest.fixture(scope="module")
def holdings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packing")
    make_dances(folder / "archive")
    (folder / "uploads").mkdir()
    return Holdings(str(folder / "archive"), folder / "uploads")


def test_voxels_come_back_where_they_are_in_their_colors(holdings):
    take = holdings.take("filmed")
    content = _voxels(holdings, take, 9, 3)
    for frame, numbers, color, label in read_voxels(content, 3):
        occupied = np.pad(box(frame), 1)
        inside = np.ones(SHAPE, bool)
        for axis in range(3):
            for by in (-1, 1):
                inside &= np.roll(occupied, by, axis)[1:-1, 1:-1, 1:-1]
        expected = np.flatnonzero(box(frame) & ~inside)
        assert numbers == expected.tolist()
        high = np.unravel_index(expected, SHAPE)[1] >= 20
        assert label == np.where(high, 1, 2).tolist()
        wanted = np.where(high[:, None], [30, 40, 220], [220, 40, 30])
        assert np.abs(color.astype(int) - wanted).max() <= 4
    assert struct.unpack_from("<f", content, 16)[0] == pytest.approx(VOXEL_M)
    assert struct.unpack_from("<3f", content, 20) == pytest.approx(ORIGIN_M)


def test_a_minute_and_a_body_are_few_bytes():
    minute = np.concatenate([swaying_body(seed, 720) for seed in range(10)])  # 120 Hz
    assert len(gzip.compress(pack_track(minute, 0, 1))) < 1.5e6


def test_a_palette_has_the_colors_that_are_there():
    color = np.array([[250, 10, 10], [10, 250, 10], [10, 10, 250]], np.uint8).repeat(50, 0)
    palette, place = make_palette(color)
    index = (color >> 3).astype(int) @ [1024, 32, 1]
    assert np.abs(palette[place[index]].astype(int) - color).max() <= 1


def test_too_many_or_no_frames_are_refused(holdings):
    motion = holdings.motion("asked")
    with pytest.raises(ValueError, match="within 0-239"):
        _track(motion, 500, 600, 1)
    with pytest.raises(ValueError, match="has the frames 0-59"):
        _voxels(holdings, holdings.take("filmed"), 60, 5)


@pytest.mark.parametrize(
    ("host", "bound", "own"),
    [
        ("127.0.0.1:8080", "127.0.0.1", True),
        ("localhost:9", "127.0.0.1", True),
        ("[::1]:8080", "127.0.0.1", True),
        ("evil.example:8080", "127.0.0.1", False),
        ("127.0.0.1.evil.example", "127.0.0.1", False),
        ("192.168.1.5:8080", "127.0.0.1", False),
        ("192.168.1.5:8080", "0.0.0.0", True),
        ("evil.example", "0.0.0.0", False),
        ("", "127.0.0.1", False),
    ],
)
def test_only_names_of_this_machine_are_answered(host, bound, own):
    assert is_own_host(host, bound) is own


def test_what_is_asked_comes_back_from_its_address():
    asking = Asking(
        take="a b&c", start=3, end=40, part="feet", weights={"RFoot": 0.5, "Head": 2.0}, top=25,
        threshold=0.05, mirror=True, path_weight=0.3, match=4, searched=True,
    )  # fmt: skip
    values = {name: value for name, value in asking.address().items() if value is not None}
    assert read_address(values) == (asking, [])
    assert asking.settings().weights == (("RFoot", 0.5), ("Head", 2.0))


def test_an_address_may_name_a_level():
    asking, strange = read_address({"part": "arms", "threshold": "like"})
    assert strange == []
    assert asking.threshold == asking.levels()["like"] > asking.levels()["same"]
    assert asking.threshold != read_address({"threshold": "like"})[0].threshold
    _, strange = read_address({"threshold": "near"})
    assert strange == ["threshold=near"]
    weights = ",".join(f"{joint}:0" for joint in JOINTS)
    asking, strange = read_address({"weights": weights, "threshold": "like"})
    assert (asking.threshold, asking.levels(), strange) == (None, {}, [])


def test_takes_are_found_by_all_words_of_their_metadata(holdings):
    records, _ = holdings.records()
    assert [r.take for r in matching(records, "the ASKED tk")] == ["asked"]
    assert matching(records, "asked nobody") == []
    assert len(matching(records, " ")) == len(records)


def test_a_strip_draws_what_is_there():
    poses = swaying_body(1, 4)
    whole = strip_path(poses)
    poses[:, JOINTS.index("Head")] = np.nan
    assert 0 < strip_path(poses).count("M") < whole.count("M")
    assert strip_path(np.full((2, 21, 3), np.nan)) == ""


def test_texts_are_there_in_both_languages_with_the_same_places():
    for name, (english, japanese) in _TEXTS.items():
        assert english, name
        assert japanese, name
        assert set(re.findall(r"{\w+}", english)) == set(re.findall(r"{\w+}", japanese)), name
    assert choose_language(None, None, "fr-FR,ja;q=0.8,en;q=0.7") == "ja"
    assert choose_language("en", "ja", "ja") == "en"
    assert choose_language("xx", None, "") == "en"


def test_a_digitization_is_started_once_and_told(tmp_path):
    started = []

    def start(capture, said):
        started.append(capture)
        program = f"import sys; sys.stderr.write('frame 1\\n{capture}: refused\\n'); sys.exit(3)"
        with said.open("wb") as into:
            return subprocess.Popen([sys.executable, "-c", program], stderr=into)

    def ended(work):
        deadline = time.monotonic() + HANGING_S
        while (state := work.state("okuri"))["running"]:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        return state

    work = Digitizations(start, tmp_path)
    assert work.state("okuri") == {"running": False, "code": None, "said": ""}
    work.start("okuri", tmp_path / "capture")
    work.start("okuri", tmp_path / "capture")
    assert ended(work) == {"running": False, "code": 3, "said": f"{tmp_path / 'capture'}: refused"}
    assert started == [str(tmp_path / "capture")]
    work.start("okuri", tmp_path / "again")
    assert ended(work)["said"] == f"{tmp_path / 'again'}: refused"
    assert started[1:] == [str(tmp_path / "again")]
