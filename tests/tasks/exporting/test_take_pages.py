"""The page of a take says what was measured, shows it, and what users wrote is only letters."""

import base64
import re

import cv2
import numpy as np
import pytest

from storage import create_archive
from storage.archive import Take
from tasks.exporting.markdown import MOST_BYTES, drawing, escaped, linked, picture
from tasks.exporting.take_pages import take_line, take_page
from tests.figures.archives.digitized_takes import (
    CONFIDENCE,
    EMPTY,
    FRAMES,
    RATE_HZ,
    STATURE_M,
    VOXEL_M,
    write_digitized,
)

HOSTILE = '<script>alert("x")</script> | a\nb # **bold** [link](javascript:alert(1)) `code` ~~no~~'
DOUBTFUL = (2, 3, 4, 6, 9)


NOTES = ["A note.", f"A camera is called {HOSTILE}"]
SECONDS = {"silhouettes": 2.0, "pose_fitting": 61.26}


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    """A take with its pose, of which a person should look at some frames."""
    place = create_archive(tmp_path_factory.mktemp("pages") / "archive").place
    metadata = {"title": HOSTILE, "performer": "小林 " + HOSTILE, "a | b": HOSTILE}
    record = write_digitized(place, "okuri48", doubtful=DOUBTFUL, metadata=metadata, notes=NOTES)
    return Take(place, record)


@pytest.fixture(scope="module")
def page(take):
    return take_page(take, SECONDS)


def cells(page):
    """Return the rows of all tables by their first cell."""
    rows = re.findall(r"^\| (.*?) \| (.*?) \|$", page, flags=re.M)
    return {name: value for name, value in rows if name != "---"}


def pictures(page):
    for kind, text in re.findall(r"!\[[^\]]+\]\(data:image/(\w+);base64,([^)]+)\)", page):
        content = base64.b64decode(text, validate=True)
        yield kind, content, cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)


def test_what_was_measured_is_on_the_page(take, page):
    said = cells(page)
    counts = [int(take.occupied(frame).values.sum()) for frame in range(FRAMES)]
    median = int(np.median(counts))
    assert said["length"] == f"{FRAMES} frames at {RATE_HZ:g} Hz, {FRAMES / RATE_HZ:.1f} s"
    assert said["cameras"] == "3: front, \\_side\\_, left"
    assert said["voxels"].startswith(f"{median:,} in a frame")
    assert said["voxels"].endswith(f"{median * VOXEL_M**3 * 1000:.1f} liters")
    assert said["frames without voxels"] == str(len(EMPTY))
    assert said["stature"] == f"{STATURE_M:.3f} m, given in capture.toml"
    assert said["body"] == f"measured in frame 0, confidence {CONFIDENCE:.2f}"
    assert said["joints"] == "21 present in most frames"
    assert said["doubtful frames"] == f"{len(DOUBTFUL)} of {FRAMES}"
    assert said["pose fitting"] == "61.3"
    assert said["together"] == "63.3"
    assert "\n- A note.\n" in page
    assert "please look at 5 doubtful frames** (42%)" in page
    assert "\n2-4, 6, 9\n" in page
    assert take_line(take) == "okuri48: 12 frames at 10 Hz, 5 of them doubtful"


def test_status_comes_first_and_doubts_before_pictures(page):
    order = [page.index(part) for part in ("**In the", "| measured", "## Doubtful", "![")]
    assert order == sorted(order)


def test_pictures_are_small_whole_and_not_blank(page):
    found = list(pictures(page))
    assert len(found) == page.count("data:image") == 4
    for kind, content, image in found:
        assert kind in ("png", "webp")
        assert 300 < len(content) <= 5_000  # the dashboard keeps them twice
        assert min(image.shape[:2]) > 100
        assert image.std() > 5


def test_a_frame_that_shows_something_is_shown(page):
    """The one nearest to the middle, 6, that is neither doubtful nor empty."""
    assert "## Frame 5" in page


def test_doubtful_frames_lead_to_the_viewer_where_its_address_is_known(take):
    text = take_page(take, {}, "http://127.0.0.1:8080/")
    assert "[2-4](http://127.0.0.1:8080/?take=okuri48&clip=2-4), [6](http://127" in text


def test_a_take_without_a_pose_says_so(take):
    record = write_digitized(take.place, "bare", posed=False, metadata={"title": "Okuri"})
    bare = Take(take.place, record)
    text = take_page(bare, {})
    assert text.startswith("# Okuri\n")
    assert "without a pose**: it is not searched" in text
    assert "stature" not in cells(text)
    assert len(list(pictures(text))) == 2  # the body and what the cameras saw
    assert take_line(bare).endswith("no pose")


def test_what_users_wrote_is_letters_and_nothing_else(page):
    text = re.sub(r"\(data:image[^)]+\)", "", page)
    assert not re.search(r"<[a-zA-Z/!]", text)
    assert not re.search(r"(?<!\\)\]\(javascript", text)
    assert not re.search(r"(?<!\\)\*\*bold", text)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    for line in lines:  # no cell more than the two of its table
        assert len(re.findall(r"(?<!\\)\|", line)) == 3, line
    assert cells(page)["performer"].startswith("小林 &lt;script&gt;")
    first = text.splitlines()[0]
    assert first.startswith("# &lt;script")
    assert "bold" in first  # the line break has become a space


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("salsa_01", "salsa_01"),
        ("_so_", "\\_so\\_"),
        ("a\r\n\n b\tc", "a b c"),
        ("\x1b[31m\u202ered", "\\[31mred"),
        ("http://evil.example", "http:&#47;&#47;evil.example"),
        ("&lt;", "&amp;lt;"),
        (None, "None"),
        ("", ""),
    ],
)
def test_a_text_is_one_line_that_does_nothing(text, said):
    assert escaped(text) == said


@pytest.mark.parametrize(
    "address", ["", "javascript:alert(1)", "data:text/html,x", "http://a b", "http://a)b", "//a"]
)
def test_only_addresses_of_the_web_become_links(address):
    assert linked("okuri", address) == "okuri"


def test_a_picture_that_is_too_large_becomes_smaller():
    noise = np.random.default_rng(5).integers(0, 255, (700, 900, 3), dtype=np.uint8)
    [(kind, content, image)] = pictures(picture(noise, "noise"))
    assert (kind, len(content) <= MOST_BYTES) == ("webp", True)
    assert image.shape[0] * 9 == pytest.approx(image.shape[1] * 7, rel=0.05)


def test_a_drawing_is_small_and_its_edges_are_sharp():
    """Colors of few shades come back to the digit, and no other is off by more than half a step."""
    rng = np.random.default_rng(1)
    image = np.full((160, 480, 3), 255, np.uint8)
    for start in rng.integers(0, 400, 12):
        image[start // 4 : start // 4 + 30, start : start + 3] = rng.choice([0, 51, 204], 3)
    image[100:140, :] = 225
    [(kind, content, found)] = pictures(drawing(image, "bars"))
    assert (kind, len(content) < 2000) == ("webp", True)
    shown = found[..., ::-1].astype(int)
    np.testing.assert_array_equal(shown[:100], image[:100])
    assert np.abs(shown - image).max() <= 25
    with pytest.raises(ValueError, match="is no picture"):
        drawing(image[..., 0], "gray")
