"""How late films began, on silhouettes of balls that move as a body does, drawn by themselves."""

import numpy as np
import pytest

from tasks.capture.offsets import LIKELY_PX, SURE_PX, find_loss, measure_lateness, reach_of
from tasks.capture.standing import find_standing
from tasks.capture.tangency import (
    Touches,
    find_outline,
    find_touches,
    join_outlines,
    join_touches,
    touches_of,
    usable_touches,
)
from tasks.checks.offsets import Passage, Timing, judge_beginnings
from tasks.geometry.projection import Projection, camera_centers
from tests.figures.balls import CAMERA, CAMERAS, SIZE, cameras, draw

pytestmark = pytest.mark.compiled  # whole films are drawn and compared at every lag

FRAMES = 110
NAMES = [f"cam{n}" for n in range(CAMERAS)]


def touches_at(late, *, frames=FRAMES, start=0.0):
    """What touches the silhouettes of cameras that began so many frames late."""
    return touches_of(draw([start + np.arange(frames) + each for each in late]), CAMERA)


def judge(touches, *, offsets_s=(0.0,) * CAMERAS, unequal="", start=0):
    timing = Timing(NAMES, 30.0, 1, offsets_s, 0.75)
    return judge_beginnings([Passage(start, touches)], CAMERA, timing, unequal=unequal)


@pytest.fixture(scope="module")
def together():
    return touches_at([0.0] * CAMERAS)


def cut(touches, chosen):
    """The planes where each camera shows the frames chosen."""
    count = min(map(len, chosen))
    planes = touches.planes[..., :count].copy()
    for pair, both in zip(touches.pairs, touches.planes, strict=True):
        number = int(np.flatnonzero((touches.pairs == pair).all(axis=1))[0])
        for k, camera in enumerate(pair):
            planes[number, k] = both[k][:, chosen[camera][:count]]
    return type(touches)(touches.cameras, touches.pairs, planes)


def test_the_planes_touch_all_pixels_of_a_silhouette_and_not_only_those_looked_at():
    """The lowest and highest plane among the rays of every pixel, each turned by itself."""
    straight = cameras(bent=False)
    packed = draw([np.array([3.0, 40.0])] * CAMERAS)
    found = touches_of(packed, straight)
    bits = np.unpackbits(packed, axis=-1).astype(bool)
    center = camera_centers(straight)
    for (one, other), planes in zip(found.pairs, found.planes, strict=True):
        along = center[other] - center[one]
        along /= np.linalg.norm(along)
        ahead = straight.camera_from_world[[one, other], 2, :3].sum(axis=0)
        ahead -= along * (ahead @ along)
        ahead /= np.linalg.norm(ahead)
        for k, camera in enumerate((one, other)):
            for n in range(2):
                row, column = np.nonzero(bits[n, camera])
                seen = np.stack([(column - 79.5) / 150, (row - 59.5) / 150, np.ones(len(row))])
                rays = seen.T @ straight.camera_from_world[camera, :, :3]
                angle = np.arctan2(rays @ np.cross(along, ahead), rays @ ahead) * 150 * 320 / 160
                np.testing.assert_allclose(planes[k, :, n], [angle.min(), angle.max()], atol=1e-3)


def test_what_is_cut_off_by_the_border_of_a_picture_and_who_is_not_there_touches_nothing():
    packed = np.zeros((3, CAMERAS, SIZE[1], SIZE[0] // 8), np.uint8)
    packed[0, :, 40:60, 8:10] = 255
    packed[1, :, 0:60, 8:10] = 255
    found = touches_of(packed, CAMERA)
    assert np.isfinite(found.planes[..., 0]).all()
    assert np.isnan(found.planes[..., 1]).any(axis=(0, 1)).any()
    assert np.isnan(found.planes[..., 2]).all()


def test_frames_may_be_looked_at_in_parts(together):
    packed = draw([np.arange(9.0)] * CAMERAS)
    parts = [touches_of(packed[:4], CAMERA), touches_of(packed[4:], CAMERA)]
    np.testing.assert_array_equal(join_touches(parts).planes, together.planes[..., :9])
    assert np.isnan(join_touches(parts, 3).planes[..., 4:7]).all()
    outlines = [
        join_outlines([find_outline(packed[a:b, c], CAMERA, c) for a, b in ((0, 2), (2, 9))])
        for c in range(CAMERAS)
    ]
    joined = find_touches(outlines, CAMERA)
    np.testing.assert_array_equal(joined.planes, together.planes[..., :9])


@pytest.mark.parametrize(
    "late",
    [
        (0, 0, 0, 0, 0), (1, 0, 0, 0, 0), (0, 0, 3, 0, 0), (0, 0, 0, -8, 0), (0, 5, 0, 0, -2),
        (0, 0.5, 0, 0, 0),
    ],
    ids=str,
)  # fmt: skip
def test_films_that_began_late_are_measured_to_a_fifth_of_a_frame(late, together):
    if all(float(each).is_integer() for each in late):
        chosen = [np.arange(8 + each, 100 + each) for each in late]
        touches = cut(together, chosen)
    else:
        touches = touches_at(late)
    found = measure_lateness(usable_touches(touches, CAMERA), 12)
    assert (found.growth >= SURE_PX).all()
    np.testing.assert_allclose(found.late, np.array(late, float), atol=0.2)


def test_what_is_said_of_late_films_is_the_line_that_mends_them(together):
    touches = cut(together, [np.arange(each, 95 + each) for each in (0, 3, 0, 0, 1)])
    said = judge(touches)
    [fault] = said.faults
    assert "'cam1' is 3.0 frames (0.1" in fault or "'cam1' is 2.9 frames (0.0" in fault
    assert f"write `{said.line}` under [video] of capture.toml" in fault
    assert said.line.startswith("offset_s = { cam1 = 0.")
    assert "cam4 = 0.0" in said.line
    # what stands there already is in the line too, and what is left is added to it
    more = judge(touches, offsets_s=(0.5, 0.2, 0.0, 0.0, 0.0)).line
    assert "cam0 = 0.5000" in more
    assert "cam1 = 0.29" in more or "cam1 = 0.30" in more


def test_films_that_began_together_raise_no_alarm(together):
    said = judge(together)
    assert (said.faults, said.notes, said.line) == ((), (), "")
    assert np.abs(said.late_frames).max() < 0.2
    unequal = judge(together, unequal="the videos are of unequal length: x; so cut them")
    assert unequal.line == "offset_s = { cam0 = 0.0000 }"
    assert unequal.faults == (
        "the videos are of unequal length: x; by the silhouettes all films began together: write "
        "`offset_s = { cam0 = 0.0000 }` under [video] of capture.toml, and the take is cut to the "
        "moments that all films show",
    )


@pytest.mark.parametrize("frames", [1, 3])
def test_frames_lost_in_a_film_are_told_with_their_place(frames):
    whole = touches_at([0.0] * CAMERAS, frames=200)
    every = np.arange(200)
    chosen = [every, every, np.delete(every, range(90, 90 + frames)), every, every]
    said = judge(cut(whole, chosen), start=1000)
    assert said.loses == (False, False, True, False, False)
    [fault] = said.faults
    assert f"camera 'cam2' lost {frames}." in fault or f"lost {frames - 0.1:.1f}" in fault
    place = int(fault.split("at about frame ")[1].split()[0])
    assert abs(place - 1090) <= 6
    twice = [every, every, np.insert(every, 90, [90] * frames), every, every]
    assert "has twice" in judge(cut(whole, twice)).faults[0]


def test_a_film_that_stands_still_while_the_others_go_on_is_told_with_its_frames():
    whole = touches_at([0.0] * CAMERAS, frames=200)
    every = np.arange(200)
    hangs = np.where((every >= 60) & (every < 130), 60, every)
    said = judge(cut(whole, [every, every, every, hangs, every]), start=1000)
    [fault] = said.faults
    assert "the film of camera 'cam3' stands still in frames 1" in fault
    first, last = map(int, fault.split("in frames ")[1].split()[0].split("-"))
    assert first == 1060
    assert last == 1129
    assert said.loses == (False, False, False, True, False)
    assert said.notes == ()
    blinks = np.where((every >= 60) & (every < 85), 60, every)
    assert not find_standing(cut(whole, [every, every, every, blinks, every]), 30)


def test_a_film_that_stands_still_while_the_others_pause_at_both_ends_is_told():
    """Each stretch of two steps holds the one in which the others move."""
    own, others = 0.2 * np.arange(4.0), np.array([0.0, 0.0, 10.0, 10.0])
    pairs = np.array([[0, 1], [0, 2], [1, 2]])
    planes = np.array([[[own if c == 0 else others] * 2 for c in pair] for pair in pairs])
    assert find_standing(Touches(3, pairs, planes.astype(np.float32)), 2) == [(0, 0, 4)]


def test_a_camera_that_a_performer_moves_toward_stands_not_still():
    """Planes through it stay where they are by the other cameras too."""
    still, others = np.zeros(60), 2.0 * np.arange(60.0)
    pairs = np.array([[0, 1], [0, 2], [1, 2]])
    planes = np.array([[[still if 0 in pair else others] * 2 for _ in pair] for pair in pairs])
    assert find_standing(Touches(3, pairs, planes.astype(np.float32)), 30) == []


def test_a_performer_who_stands_still_stops_no_film(together):
    every = np.arange(FRAMES)
    pauses = np.where((every >= 30) & (every < 75), 30, every)
    assert find_standing(cut(together, [pauses] * CAMERAS), 30) == []
    assert find_standing(cut(together, [every, every, every, pauses, every]), 30) == [(3, 30, 75)]
    unseen = cut(together, [every, every, every, pauses, every])
    unseen.planes[:, :, :, 30:75] = np.nan
    assert find_standing(unseen, 30) == []


def test_the_place_of_a_loss_is_found_by_trying_each(together):
    every = np.arange(FRAMES)
    chosen = [np.delete(every, range(40, 44)), every, every, every, every]
    late = np.zeros(CAMERAS)
    assert abs(find_loss(cut(together, chosen), late, 0, 4.0) - 40) <= 3


def test_who_stands_still_or_is_filmed_at_another_time_cannot_be_known(together):
    still = cut(together, [np.full(FRAMES, 30)] * CAMERAS)
    said = judge(still)
    assert said.faults == ()
    assert np.isnan(said.late_frames).all()
    assert "Whether the films began together cannot be known, as the performer" in said.notes[0]
    assert "clap or jump" in said.notes[0]
    assert judge(still, unequal="the videos are of unequal length: x").faults == (
        "the videos are of unequal length: x",
    )
    every = np.arange(FRAMES)
    backwards = judge(cut(together, [every, every, every[::-1], every, every]))
    assert backwards.faults == ()
    assert np.isnan(backwards.late_frames).tolist() == [False, False, True, False, False]
    assert "film of camera 'cam2' began cannot be known" in backwards.notes[0]


def test_too_few_frames_or_cameras_tell_nothing(together):
    assert judge(together.part(0, 20)).notes == (
        "Whether the films began together cannot be known from 20 frames.",
    )
    assert [reach_of(n, 60) for n in (0, 30, 110, 900)] == [0, 5, 18, 60]
    alone = Projection(*(getattr(CAMERA, name)[:1] for name in CAMERA.__dataclass_fields__))
    found = measure_lateness(touches_of(draw([np.arange(30.0)] * CAMERAS)[:, :1], alone), 5)
    assert (found.late.tolist(), found.growth.tolist()) == ([0.0], [0.0])


def test_a_camera_that_sees_nobody_does_not_disturb_the_others():
    packed = draw([np.arange(80.0) + 2 * (c == 1) for c in range(CAMERAS)])
    packed[:, 3] = 0
    said = judge(touches_of(packed, CAMERA))
    assert np.isnan(said.late_frames[3])
    assert said.late_frames[1] == pytest.approx(2.0, abs=0.2)
    assert "camera 'cam3' began cannot be known" in said.notes[0]
    assert LIKELY_PX < SURE_PX


def moving_in(touches, chosen, share):
    """The planes move by this share between cameras of the chosen ones, and stand still else."""
    middle = np.nanmedian(touches.planes, axis=-1, keepdims=True)
    moves = share * np.all(np.isin(touches.pairs, chosen), axis=1)[:, None, None, None]
    planes = middle + moves * (touches.planes - middle)
    return type(touches)(touches.cameras, touches.pairs, planes.astype(np.float32))


@pytest.mark.parametrize("share", [0.04, 0.2])
def test_films_that_tell_nothing_are_no_measure_for_those_that_do(share):
    """Any lag fits the last two, so that with them the film that is late was the one in step."""
    touches = moving_in(touches_at([0.0, 2.0, 0.0, 0.0, 0.0]), [0, 1, 2], share)
    late = measure_lateness(touches, reach_of(FRAMES, 60)).late
    np.testing.assert_allclose(late[:3], [0.0, 2.0, 0.0], atol=0.1)
    together = moving_in(touches_at([0.0] * CAMERAS), [0, 1], share)
    assert judge(together).faults == ()


def test_where_few_films_tell_none_seems_late_and_where_most_do_one_does():
    """Of two films that differ by two frames either may be late."""
    late = touches_at([0.0, 4.0, 0.0, 0.0, 0.0])
    few = judge(moving_in(late, [0, 1], 0.1))
    assert few.faults == ()
    assert few.notes[0].startswith("Whether the films began together cannot be known")
    most = judge(moving_in(late, [0, 1, 2, 3], 0.04))
    assert most.notes[0].startswith("The film of camera 'cam1' seems to be 4.0 frames")
