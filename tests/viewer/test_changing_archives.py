"""Pages that are open while their archive changes, is damaged or goes away."""

import io

import cv2
import numpy as np
import pytest
import trimesh

from storage import open_archive
from storage.formats.capture.initial import read_initial
from storage.formats.pictures.pictures import write_png
from storage.schema import SEGMENTS
from storage.upkeep.verification import verify_take
from tests.figures.archives.dances import HOSTILE, SHARED, VOXELS, add_dance, lively, make_dances
from tests.viewer.conftest import DRAWN, drawn_frames, open_viewer, opened, poll, wait

pytestmark = [pytest.mark.slow, pytest.mark.compiled]


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """An archive of this file, which its tests change one after the other."""
    location = tmp_path_factory.mktemp("changing") / "archive"
    make_dances(location)
    return location


@pytest.fixture(scope="module")
def viewer(archive):
    """The address of a viewer of that archive."""
    with open_viewer(archive) as opened:
        yield opened.url


@pytest.fixture(scope="module")
def capture(archive):
    """The capture of the filmed take: two cameras, whose pictures are as light as their number."""
    folder = archive.parent / "capture"
    for camera, tint in (("left", [1, 0, 0]), ("right", [0, 1, 0])):
        (folder / "videos" / camera).mkdir(parents=True)
        for frame in range(60):
            picture = np.full((6, 8, 3), np.multiply(tint, 4 * frame), np.uint8)
            write_png(folder / "videos" / camera / f"{frame:03d}.png", picture)
    return folder


def edit(page, take):
    """Begin to change the words of a recording."""
    wait(
        page, "take => document.querySelector(`.take[data-take=${take}][aria-selected=true]`)", take
    )
    page.click("[data-control=edit]")


def test_words_of_a_recording_are_changed_and_its_data_are_not(open_page, archive):
    before = open_archive(archive).take("other").record
    pages = [open_page("/browse?take=other") for _ in range(2)]
    for page in pages:
        edit(page, "other")
    first, second = pages
    first.fill("[data-field=title]", "Okuri, revised")
    first.fill("[data-field='+name']", "place")
    first.fill("[data-field='+text']", "Kyoto <b>")
    first.click("[data-control=save-words]")
    wait(first, "() => document.querySelector('.about h2').textContent.includes('Okuri, revised')")
    wait(
        first,
        "() => document.querySelector('.take[data-take=other] b').textContent === 'Okuri, revised'",
    )
    assert "Kyoto <b>" in first.locator(".about dl").inner_text()
    second.fill("[data-field=performer]", "somebody")
    second.click("[data-control=save-words]")
    wait(
        second,
        "() => document.querySelector('.about [role=alert]').textContent.includes('Somebody else has changed')",
    )
    assert second.input_value("[data-field=performer]") == "somebody"  # what was typed is not lost
    after = open_archive(archive).take("other").record
    assert after.metadata == {"title": "Okuri, revised", "performer": "TK", "place": "Kyoto <b>"}
    assert (after.number, after.version, after.files) == (
        before.number + 1,
        before.version,
        before.files,
    )
    assert verify_take(open_archive(archive).place, "other") == []


@pytest.mark.long
@pytest.mark.usefixtures("capture")
def test_films_go_in_step_with_the_body(open_page):
    page = open_page("/browse?take=filmed")
    wait(page, "() => window.shosa.film")
    page.click("[data-control=play]")
    page.keyboard.press("Home")
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    wait(
        page, "() => window.shosa.film?.frame === 10 && window.shosa.stage.figures[0].frame === 10"
    )
    colors = page.evaluate(
        "async () => { const i = document.querySelector('.films img'); await i.decode(); const c = new OffscreenCanvas(i.naturalWidth, i.naturalHeight).getContext('2d'); c.drawImage(i, 0, 0);"
        "return [0.25, 0.75].map(y => [...c.getImageData(i.naturalWidth / 2, i.naturalHeight * y, 1, 1).data]); }"
    )
    np.testing.assert_allclose(colors, [[40, 0, 0, 255], [0, 40, 0, 255]], atol=6)
    page.select_option("[data-control=camera]", "right")
    wait(page, "() => window.shosa.film?.camera === 'right'")


@pytest.mark.long
def test_a_picture_from_here_and_the_colored_voxels_are_saved(open_page):
    page = open_page("/browse?take=filmed")
    wait(page, "() => window.shosa.stage?.bodies?.[0]?.count")
    page.click("[data-control=play]")
    page.keyboard.press("Home")
    with page.expect_download() as download:
        page.click("[data-link=view]")
    assert download.value.suggested_filename == "filmed-0.png"
    picture = cv2.imread(str(download.value.path()))
    blue, red = ((picture[..., a] > 130) & (picture[..., b] < 90) for a, b in ((0, 2), (2, 0)))
    assert blue.sum() > 1000
    assert red.sum() > 1000
    assert np.argwhere(blue)[:, 0].mean() < np.argwhere(red)[:, 0].mean()  # the blue is above
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    with page.expect_download() as download:
        page.click("[data-link=voxels]")
    assert download.value.suggested_filename == "filmed-58-59.glb"
    scene = trimesh.load(io.BytesIO(download.value.path().read_bytes()), file_type="glb")
    assert len(scene.geometry) == 2


@pytest.mark.long
def test_painted_voxels_are_saved_and_of_two_people_the_second_is_told(open_page, capture):
    address = "/body?take=filmed&frame=20"
    first, second = (open_page(address, faults_expected=True) for _ in range(2))
    for page in (first, second):
        wait(page, "() => window.shosa?.bodyModel?.labels?.length > 0")
    before = first.evaluate("() => window.shosa.bodyModel.shares")
    first.click("[data-move=brush]")
    first.click("[data-segment=RForeArm]")
    first.locator("[data-control=radius]").evaluate(
        "e => { e.value = 0.15; e.dispatchEvent(new Event('input')); }"
    )
    box = first.locator(".body-view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    first.mouse.move(x - 30, y)
    first.mouse.down()
    first.mouse.move(x + 30, y, steps=4)
    first.mouse.up()
    arm = SEGMENTS.index("RForeArm")
    wait(first, "before => window.shosa.bodyModel.shares[4] > before[4] + 0.005", before)
    shares = first.evaluate("() => window.shosa.bodyModel.shares")
    first.click("[data-control=undo]")
    wait(
        first,
        "before => JSON.stringify(window.shosa.bodyModel.shares) === JSON.stringify(before)",
        before,
    )
    first.mouse.move(x - 30, y)
    first.mouse.down()
    first.mouse.move(x + 30, y, steps=4)
    first.mouse.up()
    wait(first, "before => window.shosa.bodyModel.shares[4] > before[4] + 0.005", before)
    first.click("[data-control=save]")
    wait(first, "() => document.querySelector('[data-saved]').textContent.includes('Saved')")
    saved = read_initial(capture / "initial.json")
    assert len(saved.label) == VOXELS
    assert np.mean(saved.label == arm + 1) == pytest.approx(shares[arm], abs=0.01)
    second.click("[data-control=save]")
    wait(
        second, "() => document.querySelector('[data-saved]').textContent.includes('somebody else')"
    )
    second.reload()  # what the other has painted is shown
    wait(
        second,
        "share => Math.abs(window.shosa?.bodyModel?.shares?.[4] - share) < 1e-4",
        float(np.mean(saved.label == arm + 1)),
    )


def test_a_hostile_title_stays_a_title(open_page, archive):
    add_dance(archive, "hostile", lively(5, 90), title=HOSTILE)
    page = open_page("/?take=hostile")
    wait(page, DRAWN)
    assert "taken over" not in page.title()
    assert page.get_by_role("combobox").first.input_value().startswith(HOSTILE)


@pytest.mark.long
def test_two_visitors_do_not_disturb_each_other_while_a_take_is_replaced(open_page, archive):
    pages = [opened(open_page), open_page("/?take=other&clip=10-60")]
    wait(pages[1], DRAWN)
    add_dance(archive, "answer", lively(12, 280))
    pages[0].keyboard.press("End")
    assert poll(lambda: drawn_frames(pages[0])[0] == SHARED[1])  # goes on with what it has
    pages[0].click("[data-control=search]")
    wait(
        pages[0],
        "() => !document.querySelector('[data-control=search]').disabled && window.shosa.score.match",
    )
    assert pages[1].evaluate("() => window.shosa.score.query.take") == "other"


@pytest.mark.long
def test_a_damaged_take_is_told_and_the_others_searched(open_page, archive):
    for file in (archive / "takes" / "other").rglob("c/*/0/0"):
        if "position" in str(file):
            file.write_bytes(b"damaged")
    # somebody whose browser has kept nothing of it
    page = open_page("/?take=asked&clip=60-119", faults_expected=True, locale="en")
    wait(page, DRAWN)
    chooser = page.get_by_role("combobox", name="Recording")
    chooser.click()
    chooser.fill("other")
    wait(page, "() => document.querySelectorAll('.chooser-option').length === 1")
    page.keyboard.press("Enter")
    wait(
        page,
        "() => /other|verify/.test(document.querySelector('.notice').textContent + (document.querySelector('.stage-message')?.textContent || ''))",
    )
    assert "verify" in page.content()


@pytest.mark.long
def test_an_archive_that_disappears_is_told(open_page, archive):
    page = opened(open_page, faults_expected=True)
    archive.rename(archive.with_name("gone"))
    page.get_by_role("button", name="Arms", exact=True).click()
    page.click("[data-control=search]")
    wait(page, "() => document.querySelector('.notice').textContent.includes('archive')")
    archive.with_name("gone").rename(archive)
    page.click("[data-control=search]")
    wait(
        page,
        "() => document.querySelector('.notice').textContent === '' && document.querySelectorAll('.result').length > 0",
    )
