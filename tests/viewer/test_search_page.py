"""The search page in a browser: what is drawn, after each thing that a visitor can do."""

import av
import numpy as np
import pytest

from storage.schema import JOINTS
from tests.figures.archives.dances import ANSWER, SHARED, SURFACE
from tests.viewer.conftest import (
    DRAWN,
    HANGING_MS,
    LINK,
    PLAYING,
    drawn_frames,
    opened,
    poll,
    poses,
    wait,
)

pytestmark = [pytest.mark.slow, pytest.mark.compiled]

FEET = [JOINTS.index(side + end) for side in "RL" for end in ("Heel", "Foot")]
HANDS = [JOINTS.index(side + "Fin") for side in "RL"]


def test_a_first_visit_reaches_the_right_match_by_feet_only(open_page):
    page = open_page()
    chooser = page.get_by_role("combobox", name="Recording")
    chooser.click()
    chooser.fill("asked")
    wait(page, "() => document.querySelectorAll('.chooser-option').length === 1")
    page.keyboard.press("Enter")
    wait(
        page,
        "() => document.querySelector('.timeline')?.dataset.drawn === 'asked'",
    )
    for which, frame in zip(("first", "last"), SHARED, strict=True):
        field = page.locator(f"[data-field={which}]")
        field.fill(str(frame))
        field.press("Enter")
    page.get_by_role("button", name="Feet").click()
    page.get_by_role("button", name="Search the archive").click()
    wait(page, PLAYING)
    score = page.evaluate("() => window.shosa.score")
    assert (score["query"]["start"], score["query"]["end"]) == SHARED
    assert score["match"]["take"] == "answer"
    assert abs(score["match"]["start"] - ANSWER[0]) <= 2
    assert abs(score["match"]["end"] - ANSWER[1]) <= 2
    begun = page.evaluate("() => window.shosa.stage.frames")
    wait(page, "begun => window.shosa.stage.frames > begun + 3", begun)  # it plays
    page.keyboard.press(" ")
    drawn = poses(page)
    apart = np.linalg.norm(drawn["query"][0] - drawn["match"][0], axis=1)
    assert apart[FEET].max() < 0.02
    assert apart[HANDS].max() > 0.1
    assert "part=feet" in page.url
    assert "take=asked" in page.url


def test_dragging_an_end_of_the_clip_shows_the_pose_and_takes_the_frame(open_page):
    page = open_page("/?take=asked&clip=60-119")
    wait(page, DRAWN)
    bar = page.locator(".timeline-bar").bounding_box()
    handle = page.locator("[data-end=last]").bounding_box()
    y = handle["y"] + 10
    page.mouse.move(handle["x"] + 3, y)
    page.mouse.down()
    page.mouse.move(bar["x"] + bar["width"] * 200 / 239, y, steps=3)
    wait(
        page, "() => Math.abs(window.shosa.stage.figures[0].frame - 200) < 3"
    )  # before it is let go
    page.mouse.up()
    wait(page, "() => Math.abs(window.shosa.score.query.end - 200) < 3")
    assert page.evaluate("() => window.shosa.score.query.start") == 60
    wait(page, "() => /clip=60-(19[89]|20[012])/.test(location.search)")
    page.locator("[data-end=first]").focus()
    page.keyboard.press("ArrowRight")
    wait(page, "() => window.shosa.score.query.start === 61")


@pytest.mark.long
def test_every_way_to_arrange_and_play_changes_what_is_drawn(open_page):
    page = opened(open_page)
    together = poses(page)
    page.click("[data-mode=side]")
    wait(page, "() => window.shosa.stage.mode === 'side'")
    aside = poses(page)
    head = JOINTS.index("Head")
    assert aside["match"][0][head, 0] - aside["query"][0][head, 0] > 1
    page.keyboard.press("3")
    wait(page, "() => window.shosa.stage.figures.length === 1")
    page.keyboard.press("1")
    wait(page, "() => window.shosa.stage.figures.length === 2")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert poll(lambda: drawn_frames(page)[0] == SHARED[0] + 2)
    assert not np.allclose(poses(page)["query"][0], together["query"][0])
    page.locator("[data-control=time]").evaluate(
        "e => { e.value = 500; e.dispatchEvent(new Event('input')); }"
    )
    assert poll(lambda: abs(drawn_frames(page)[0] - sum(SHARED) / 2) < 2)
    page.select_option("[data-control=speed]", "0.25")
    page.uncheck("[data-control=loop]")
    page.keyboard.press("End")
    page.click("[data-control=play]")  # from the beginning again, to the end, where it stays
    wait(page, "() => document.querySelector('[data-control=play]').textContent.includes('❚')")
    page.select_option("[data-control=speed]", "2")
    wait(
        page,
        "last => window.shosa.stage.figures[0].frame === last && !document.querySelector('[data-control=play]').textContent.includes('❚')",
        SHARED[1],
    )
    camera = page.evaluate("() => window.shosa.stage.camera")
    box = page.locator(".stage-view").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 250)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 250, steps=3)
    page.mouse.up()
    assert poll(
        lambda: (
            np.abs(np.subtract(page.evaluate("() => window.shosa.stage.camera"), camera)).max()
            > 0.3
        )
    )
    page.click("[data-control=front]")
    assert poll(
        lambda: np.allclose(page.evaluate("() => window.shosa.stage.camera"), camera, atol=0.2)
    )


@pytest.mark.long
def test_time_and_place_are_matched_or_as_danced(open_page):
    page = opened(open_page, LINK + "&part=whole")
    path = page.evaluate("() => window.shosa.score.match.path")
    assert path != [[a, a] for a, _ in path]
    match = page.evaluate("() => window.shosa.score.match")
    query_s, match_s = path[len(path) // 2]
    page.locator("[data-control=time]").evaluate(
        "(e, share) => { e.value = Math.round(1000 * share); e.dispatchEvent(new Event('input')); }",
        query_s / path[-1][0],
    )
    assert poll(lambda: abs(poses(page)["match"][1] - (match["start"] + 30 * match_s)) < 1.5)
    page.keyboard.press("Home")
    page.uncheck("[data-control=warped]")
    page.keyboard.press("End")
    longest = max(match["end"] - match["start"], SHARED[1] - SHARED[0])
    assert poll(
        lambda: (
            page.evaluate("() => window.shosa.stage.figures[1].frame")
            in (match["end"], match["start"] + longest)
        )
    )
    page.keyboard.press("Home")
    page.check("[data-control=warped]")
    pinned = poll(lambda: poses(page).get("match"))[0]
    page.uncheck("[data-control=pinned]")
    assert poll(lambda: not np.allclose(poses(page)["match"][0], pinned, atol=1e-4))
    assert "pinned=no" in page.url


def test_each_setting_changes_what_is_compared(open_page):
    page = opened(open_page)
    assert page.evaluate("() => window.shosa.stage.strong") == sorted(FEET)
    page.get_by_role("button", name="Right arm").click()
    wait(
        page, "() => window.shosa.stage.strong?.length === 4 && document.querySelector('.outdated')"
    )
    page.click("[data-fold=weights] summary")
    page.locator("[data-joint=Head]").evaluate(
        "e => { e.value = 0.5; e.dispatchEvent(new Event('change')); }"
    )
    wait(
        page,
        "() => window.shosa.stage.strong?.length === 5 && location.search.includes('Head%3A0.5')",
    )
    page.get_by_role("button", name="Feet").click()
    wait(
        page,
        "() => window.shosa.stage.strong?.length === 4 && !document.querySelector('.outdated')",
    )
    assert page.input_value("[data-control=top]") == "10"
    page.fill("[data-control=top]", "3")
    page.press("[data-control=top]", "Enter")
    page.check("[data-control=mirror]")
    page.click("[data-control=search]")
    wait(page, "() => document.querySelectorAll('.result').length === 3")
    assert "mirror=yes" in page.url
    assert page.input_value("[data-control=top]") == "3"  # no answer of the server undoes it
    page.locator("[data-control=threshold]").evaluate(
        "e => { e.value = 0.01; e.dispatchEvent(new Event('change')); }"
    )
    wait(page, "() => document.body.textContent.includes('cm apart on average')")
    page.click("[data-control=search]")
    wait(page, "() => document.querySelectorAll('.result').length === 1")
    page.click("[data-level=like]")
    wait(page, "() => document.querySelector('[data-level=like]').ariaPressed === 'true'")
    reach = page.input_value("[data-control=threshold]")
    page.click("[data-part=arms]")  # the level stays, and is another distance then
    wait(page, "v => document.querySelector('[data-control=threshold]').value !== v", reach)
    assert page.get_attribute("[data-level=like]", "aria-pressed") == "true"
    page.click("[data-level=like]")
    wait(page, "() => !location.search.includes('threshold')")
    page.locator("[data-control=path]").evaluate(
        "e => { e.value = 0.5; e.dispatchEvent(new Event('change')); }"
    )
    wait(page, "() => location.search.includes('path=0.5')")


@pytest.mark.long
def test_results_are_chosen_by_click_and_by_keys(open_page):
    page = opened(open_page)
    first = page.evaluate("() => window.shosa.score.match")
    page.locator("[data-rank='2']").click()
    wait(
        page,
        "first => window.shosa.score.match.start !== first.start || window.shosa.score.match.take !== first.take",
        first,
    )
    wait(page, "() => location.search.includes('match=2')")
    page.keyboard.press("ArrowUp")
    wait(page, "first => window.shosa.score.match.start === first.start", first)
    distances = [float(text.split()[0]) for text in page.locator(".far").all_inner_texts()]
    assert distances == sorted(distances)


@pytest.mark.long
def test_curves_follow_the_frame_and_say_why_a_match_is_near(open_page):
    page = opened(open_page)
    page.select_option("[data-control=joint]", "LElbow")
    wait(
        page,
        "() => document.querySelector('[data-plot=match] figcaption').textContent.startsWith('LElbow')",
    )
    page.keyboard.press("End")
    wait(page, "last => window.shosa.cursors?.query === last", SHARED[1])
    box = page.locator("[data-plot=query] canvas").bounding_box()
    page.mouse.click(box["x"] + 38 + (box["width"] - 46) * 90 / 239, box["y"] + 30)
    wait(page, "() => Math.abs(window.shosa.stage.figures[0].frame - 90) < 3")
    page.click("[data-tab=near]")
    wait(
        page,
        "() => document.querySelector('[data-plot=along]') && document.querySelector('[data-plot=joints]')",
    )
    match = page.evaluate("() => window.shosa.score.match")
    assert [k for k, v in enumerate(match["byJoint"]) if v is not None] == sorted(FEET)
    assert max(match["near"]) < 0.01  # the feet are the same


@pytest.mark.long
def test_a_filmed_body_dances_beside_the_figure(open_page):
    page = open_page("/?take=filmed&clip=5-50")
    wait(page, "() => window.shosa?.stage?.bodies?.[0]?.count > 0")
    page.click("[data-control=play]")
    page.keyboard.press("End")
    wait(page, "() => window.shosa.stage.bodies[0].frame === 50")
    assert page.evaluate("() => window.shosa.stage.bodies[0].count") == SURFACE
    page.select_option("[data-control=voxels]", "segments")
    wait(page, "() => window.shosa.stage.bodies[0].colors === 'segments'")
    page.select_option("[data-control=voxels]", "off")
    wait(page, "() => window.shosa.stage.bodies.length === 0")


@pytest.mark.long
def test_what_is_on_the_stage_is_saved_as_a_film(open_page):
    page = open_page("/?take=asked&clip=60-75")
    wait(page, DRAWN)
    with page.expect_download(timeout=HANGING_MS) as download:
        page.click("[data-control=film]")
    with av.open(download.value.path()) as film:
        frames = list(film.decode(video=0))
    assert len(frames) > 1
    assert len(np.unique(frames[0].to_ndarray(format="rgb24").reshape(-1, 3), axis=0)) > 20


def test_a_link_opens_what_was_shared(open_page):
    page = opened(open_page, LINK + "&match=2&mode=side&joint=Head")
    assert page.locator("[aria-selected=true]").get_attribute("data-rank") == "2"
    assert page.evaluate("() => window.shosa.stage.mode") == "side"
    assert page.locator("[data-plot=query] figcaption").inner_text().startswith("Head")


@pytest.mark.long
def test_a_dropped_file_is_searched_with(open_page, write_walk, tmp_path):
    page = open_page()
    wait(page, DRAWN)
    page.set_input_files("input[type=file]", write_walk(tmp_path / "walk.trc", seed=7))
    wait(page, "() => window.shosa.score.query.version === 'file'")
    page.click("[data-control=search]")
    wait(page, PLAYING)
    assert page.evaluate("() => window.shosa.score.query.title") == "walk.trc"


@pytest.mark.long
def test_a_file_that_is_none_is_told(open_page, tmp_path):
    bad = tmp_path / "bad.bvh"
    bad.write_text("no motion")
    page = open_page(faults_expected=True)
    wait(page, DRAWN)
    page.set_input_files("input[type=file]", bad)
    wait(page, "() => document.querySelector('.notice').textContent.includes('bvh')")


@pytest.mark.long
def test_language_and_theme_are_changed_and_kept(open_page):
    page = open_page(locale="en")
    wait(page, DRAWN)
    light = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    page.click("[data-control=theme]")
    wait(page, "light => getComputedStyle(document.body).backgroundColor !== light", light)
    page.click("[data-control=language]")
    wait(page, "() => document.querySelector('.main')?.textContent.includes('検索')")
    wait(page, "() => document.body.classList.contains('body--dark')")
    assert page.evaluate("() => document.documentElement.lang") == "ja"


def test_nothing_found_says_what_to_loosen(open_page):
    page = open_page("/?take=asked&clip=0-50&search=yes&threshold=0.0002")
    wait(page, "() => document.querySelector('.found-note')?.textContent.includes('threshold')")
    assert page.locator(".result").count() == 0
    page.click("[data-control=loosen]")
    wait(page, "() => document.querySelectorAll('.result').length > 0")
    assert "threshold=0." in page.url
    assert float(page.input_value("[data-control=threshold]")) > 0.0002


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("/?take=nobody", "There is no recording “nobody”"),
        ("/?take=asked&clip=9-2&top=no&weights=Tail:1&part=wing", "clip=9-2, part=wing, top=no, weights=Tail:1"),
        ("/?take=<script>alert(1)</script>", "<script>"),
    ],
    ids=["unknown-take", "nonsense", "hostile"],
)  # fmt: skip
def test_an_address_that_means_nothing_is_told_and_a_take_shown(open_page, address, told):
    page = open_page(address)
    wait(page, DRAWN)
    assert told in page.locator(".notice").inner_text()
