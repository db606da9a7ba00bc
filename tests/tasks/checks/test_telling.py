"""What cannot tell the performer from the stage is named: ghosts, masks that are none, scraps."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.capture.backgrounds import smooth
from tasks.checks.bodies import judge_bodies
from tasks.checks.telling import (
    Telling,
    all_faults,
    filled_notes,
    judge_telling,
    narrow_notes,
    stale_shares,
    told_by,
)
from tasks.reconstruction.regions.masks import color_rim, mask_facts, silhouettes_of
from tasks.reconstruction.regions.rims import DISTANCES
from tasks.reconstruction.regions.stale_outlines import outline_of, stale_outline

ROWS, COLUMNS, FRAMES = 48, 64, 6
NAMES = ("cam1", "cam2", "cam3")
CAPTURE = SimpleNamespace(cameras=[SimpleNamespace(name=name, height=ROWS) for name in NAMES])


def disc(row, column, radius=7.0):
    """Where a round body is, (row, column) bool."""
    y, x = np.mgrid[:ROWS, :COLUMNS]
    return np.hypot(y - row, x - column) <= radius


def drawn(inside, rng, color=(180.0, 60.0, 40.0)):
    """A picture (row, column, 3) of a folded wall with a body before it."""
    _, x = np.mgrid[:ROWS, :COLUMNS]
    wall = (100.0 + 12.0 * np.sin(x / 5.0))[..., None] * np.array([1.0, 0.9, 0.8])
    picture = np.where(inside[..., None], np.array(color), wall)
    return (picture + rng.normal(0, 2, picture.shape)).clip(0, 255).astype(np.uint8)


@pytest.fixture
def rng():
    return np.random.default_rng(2)


@pytest.fixture
def seen(rng):
    """Silhouettes and stale outlines (time, camera, ...): a ghost at 24, 14 in cam2 alone."""
    silhouettes = np.zeros((FRAMES, len(NAMES), ROWS, COLUMNS), bool)
    stale = np.zeros_like(silhouettes)
    nobody = np.zeros((ROWS, COLUMNS), bool)
    for c in range(len(NAMES)):
        ghost = disc(24, 14) if c == 1 else nobody
        background = smooth(drawn(ghost, rng)).astype(np.float32)
        for t in range(FRAMES):
            body = disc(22 + t, 30 + 3 * t)
            silhouettes[t, c] = body | ghost
            stale[t, c] = stale_outline(silhouettes[t, c], drawn(body, rng), background)
    return silhouettes, stale


def test_an_outline_is_stale_where_the_background_alone_has_an_edge(seen):
    silhouettes, stale = seen
    assert not stale[:, [0, 2]].any()
    ghost = outline_of(disc(24, 14))
    assert stale[:, 1][:, ghost].mean() > 0.9
    assert not stale[:, 1][:, ~ghost].any()
    shares = stale_shares(stale, silhouettes)
    assert shares[0] == shares[2] == 0.0
    assert 0.4 < shares[1] < 0.6


def test_a_ghost_is_named_with_its_camera_and_what_to_do(seen):
    silhouettes, stale = seen
    faults, notes = judge_telling(Telling("background", stale=stale), CAPTURE, silhouettes)
    [fault] = faults
    assert fault.startswith("the performer, or something that is not in the film, stands in the")
    assert "camera 'cam2': " in fault
    assert fault.endswith('write background = "film" under [silhouettes] of digitize.toml')
    assert notes == []
    telling = Telling("film", stale=stale, sure=[0.99, 0.9, 1.0])
    [fault], [note] = judge_telling(telling, CAPTURE, silhouettes)
    assert "background that was found in the film of camera 'cam2'" in fault
    assert "cam2 10.0%" in note


def test_what_moves_is_no_ghost(seen):
    silhouettes, stale = seen
    for t in range(FRAMES):
        stale[t, 1] = np.roll(stale[t, 1], (7 * t, 11 * t), axis=(0, 1))
    assert judge_telling(Telling("background", stale=stale), CAPTURE, silhouettes) == ([], [])


def test_what_tells_is_told_by_capture_and_settings():
    masked, bare = SimpleNamespace(masks=("a",)), SimpleNamespace(masks=())
    assert told_by(masked, "given", "") == "mask"
    assert [told_by(bare, "given", ""), told_by(bare, "film", ""), told_by(bare, "given", "auto")] \
        == ["background", "film", "key"]  # fmt: skip


def facts_of(change):
    """What is known of the masks of six frames and three cameras, those of cam2 changed."""
    mask = disc(24, 30).astype(np.uint8) * 255
    return np.stack(
        [np.stack([mask_facts(change(mask) if c == 1 else mask) for c in range(3)])] * FRAMES
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda mask: 255 - mask, "the masks of camera 'cam2' are inverted: white, as the perf"),
        (lambda mask: mask // 3, "of camera 'cam2' are too dark: their largest value is 85 of 255"),
        (lambda mask: np.full_like(mask, 90), "of camera 'cam2' are pictures, not masks: 100%"),
        (lambda mask: np.where(mask, 255, np.arange(COLUMNS) * 4), "'cam2' are pictures, not mas"),
    ],
    ids=["inverted", "too dark", "gray", "a film"],
)
def test_masks_that_are_none_are_named(change, said):
    masks = facts_of(lambda mask: change(mask).astype(np.uint8))
    silhouettes = np.zeros((FRAMES, 3, ROWS, COLUMNS), bool)
    telling = Telling("mask", masks=masks)
    [fault], _ = judge_telling(telling, CAPTURE, silhouettes)
    assert said in fault
    assert all_faults(telling, [fault], ["follows from it"]) == (fault,)


@pytest.mark.parametrize("change", [lambda mask: mask, lambda mask: mask * 0])
def test_masks_are_good_though_one_camera_sees_nobody(change):
    telling = Telling("mask", masks=facts_of(change))
    assert judge_telling(telling, CAPTURE, np.zeros((FRAMES, 3, ROWS, COLUMNS), bool)) == ([], [])


def test_masks_that_are_too_narrow_are_named_with_the_line_that_mends_it():
    edges = np.ones((FRAMES, len(NAMES), len(DISTANCES) + 1))
    edges[..., -1] = 300  # pixels of rim
    for c, distance in enumerate((0.0, 1.0, -2.0)):  # where the film has its edge
        edges[:, c, np.flatnonzero(distance == DISTANCES)] = 9
    assert narrow_notes(edges[:, ::2], [240] * 2, NAMES[::2]) == []
    [note] = narrow_notes(edges, [240] * 3, NAMES)
    assert "camera 'cam2' (1). " in note
    assert "write grow_px = 1 under [silhouettes] of digitize.toml" in note
    [large] = narrow_notes(edges, [1080] * 3, NAMES)
    assert "camera 'cam2' (4). " in large
    masks = facts_of(lambda mask: mask)
    silhouettes = np.zeros((FRAMES, 3, ROWS, COLUMNS), bool)
    assert judge_telling(Telling("mask", masks=masks, edges=edges), CAPTURE, silhouettes)[1]


def test_the_rim_of_a_mask_takes_its_color_from_inside(rng):
    body = disc(24, 30, 10.0)
    image = drawn(body, rng)
    mask = disc(24, 30, 11.6).astype(np.uint8) * 255  # a pixel and a half too large
    before, silhouette = image.copy(), silhouettes_of(mask)
    color_rim(image, mask, silhouette)
    red = np.array([180, 60, 40])
    assert (np.abs(before[silhouette].astype(int) - red).max(axis=1) > 30).sum() > 50
    assert np.abs(image[silhouette].astype(int) - red).max() < 15
    np.testing.assert_array_equal(image[~silhouette], before[~silhouette])
    np.testing.assert_array_equal(image[disc(24, 30, 7.0)], before[disc(24, 30, 7.0)])


def test_what_is_thin_keeps_its_colors(rng):
    image = drawn(disc(24, 30), rng)
    mask = np.zeros((ROWS, COLUMNS), np.uint8)
    mask[20:23] = 255
    before = image.copy()
    color_rim(image, mask, silhouettes_of(mask))
    np.testing.assert_array_equal(image, before)


def soft(mask):
    return silhouettes_of(mask[None])[0]


def test_half_of_a_soft_edge_is_inside():
    ramp = np.tile(np.linspace(0, 255, 21).round().astype(np.uint8), (3, 1))
    np.testing.assert_array_equal(soft(ramp)[0], np.arange(21) >= 10)


def body_at(x, *, size=(0.3, 1.6, 0.2), voxel_m=0.04):
    axes = [np.arange(0, side, voxel_m) for side in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points + np.array([x, 0.0, 0.0])


def test_two_bodies_are_a_fault_of_masks_and_a_note_of_films():
    two = [np.concatenate([body_at(0.1 * t), body_at(1.5)]) for t in range(4)]
    [fault], notes = judge_bodies(two, 0.04, "mask")
    assert fault == (
        "two bodies are seen in 4 of 4 frames, 1.4 m apart: the masks are of two people; make "
        "masks of one performer"
    )
    assert notes == []
    faults, [note] = judge_bodies(two, 0.04, "background")
    assert faults == []
    assert note.startswith("Two bodies are seen in 4 of 4 frames, 1.4 m apart: one of them is not")


def test_a_performer_with_a_chair_or_seldom_somebody_else_is_one():
    chair = body_at(1.2, size=(0.4, 0.5, 0.4))
    with_chair = [np.concatenate([body_at(0.0), chair])] * 4
    passing = [body_at(0.0)] * 3 + [np.concatenate([body_at(0.0), body_at(1.5)])]
    for hulls in (with_chair, passing, [body_at(0.0)], [np.zeros((0, 3))]):
        assert judge_bodies(hulls, 0.04, "mask") == ([], [])


@pytest.mark.parametrize("by", ["background", "mask"])
def test_what_stands_still_beside_one_who_walks_is_noted_and_is_no_second_body(by):
    chair = body_at(-1.2, size=(0.48, 0.92, 0.48))
    walking = [np.concatenate([body_at(0.2 * t), chair]) for t in range(8)]
    faults, [note] = judge_bodies(walking, 0.04, by)
    assert faults == []
    assert note.startswith(
        "Something that is not the performer stands still at x = -0.98, z = 0.22"
    )
    standing = [np.concatenate([body_at(0.0), chair])] * 8
    faults, notes = judge_bodies(standing, 0.04, by)
    assert "wo bodies are seen in 8 of 8 frames" in "".join([*faults, *notes])


@pytest.mark.parametrize("by", ["background", "film", "key", "mask"])
def test_what_is_too_small_for_a_body_is_a_fault(by):
    scraps = [body_at(0.0, size=(0.1, 0.3, 0.1)), np.zeros((0, 3)), body_at(0.0, size=(0.12,) * 3)]
    faults, notes = judge_bodies(scraps, 0.04, by)
    assert notes == []
    assert faults[0].startswith("what the silhouettes carve is ")
    assert "liters in the median of the frames, and no body is below 6" in faults[0]


def test_holes_that_were_filled_are_told_with_their_share_by_camera():
    pixels = np.full((4, 3), 5000)
    filled = np.array([[0, 0, 0], [0, 400, 8], [0, 200, 8], [0, 0, 8]])
    names = ["left", "front", "right"]
    [note] = filled_notes(filled, pixels, names, kept=False)
    assert "camera 'front' (3.0%)." in note
    assert note.endswith("they were filled.")
    [note] = filled_notes(filled, pixels, names, kept=True)
    assert 'write holes = "fill" under [silhouettes]' in note
    assert filled_notes(0 * filled, pixels, names, kept=True) == []
    assert filled_notes(0 * filled, 0 * pixels, names, kept=False) == []
