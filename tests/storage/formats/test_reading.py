"""What every reader of motion files checks: zeros that are gaps, bytes that are no UTF-8."""

import numpy as np
import pytest

from storage.errors import InputError
from storage.formats.reading import decode_toml, without_zeros

NAMES = ("Head", "RHip", "LHip", "RKnee", "LKnee", "RAnkle", "LAnkle")


@pytest.fixture
def body(rng):
    """Seven markers of a body that walks by, 9 frames."""
    shape = np.array([[0, 1.6, 0], [0.1, 0.9, 0], [-0.1, 0.9, 0], [0.1, 0.5, 0], [-0.1, 0.5, 0],
                      [0.1, 0.1, 0], [-0.1, 0.1, 0]])  # fmt: skip
    return shape + rng.normal(0, 0.01, (9, 7, 3)) + np.linspace(1, 2, 9)[:, None, None]


@pytest.fixture
def rng():
    return np.random.default_rng(16)


def test_a_marker_at_zero_in_some_frames_is_missing_there_alone(body):
    torn = body.copy()
    torn[3:5, 1] = torn[8, 0] = 0.0
    torn[2, 5, :2] = 0.0  # on an axis, not at the origin
    cleaned, notes = without_zeros(torn, NAMES)
    missing = np.isnan(cleaned)
    assert np.argwhere(missing.all(axis=2)).tolist() == [[3, 1], [4, 1], [8, 0]]
    np.testing.assert_array_equal(cleaned[~missing], torn[~missing])
    assert missing.sum() == 9
    assert "3 positions are exactly 0, 0, 0" in notes[0]
    assert "(frames of Head 1, RHip 2)" in notes[0]


def test_frames_in_which_nothing_was_seen_are_missing(body):
    body[4] = 0.0
    assert np.isnan(without_zeros(body, NAMES)[0][4]).all()


@pytest.mark.parametrize("lost", [[2], [2, 4]])
def test_markers_that_are_always_at_zero_were_never_seen(body, lost):
    body[:, lost] = 0.0
    cleaned, notes = without_zeros(body, NAMES)
    assert np.isnan(cleaned).all(axis=(0, 2)).nonzero()[0].tolist() == lost
    assert "in every frame: taken as never seen" in notes[-1]


def test_the_origin_of_a_body_centered_file_stays(body):
    centered = body - body[:, 1:2]
    centered[6, 5] = 0.0
    cleaned, notes = without_zeros(centered, NAMES)
    assert (cleaned[:, 1] == 0).all()
    assert np.argwhere(np.isnan(cleaned).all(axis=2)).tolist() == [[6, 5]]
    assert len(notes) == 1


def test_nothing_is_said_of_positions_without_zeros(body):
    cleaned, notes = without_zeros(body, NAMES)
    assert cleaned is body
    assert notes == []


@pytest.mark.parametrize(
    ("encoding", "said"),
    [("cp932", "looks like cp932"), ("utf-16", "looks like UTF-16"), ("gbk", "is not in UTF-8;")],
)
def test_toml_in_another_encoding_is_refused_with_its_name(tmp_path, encoding, said):
    text = 'title = "' + ("左膝" if encoding == "gbk" else "春の海") + '"'
    with pytest.raises(InputError, match=f"{said}.*save it as UTF-8"):
        decode_toml(tmp_path / "haru.toml", text.encode(encoding))
    assert decode_toml(tmp_path, text.encode("utf-8-sig")) == text
