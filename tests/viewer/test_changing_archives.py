"""Pages that are open while their archive changes, is damaged or goes away."""

import pytest

from tests.figures.dances import HOSTILE, SHARED, add_dance, lively, make_dances
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


def test_a_hostile_title_stays_a_title(open_page, archive):
    add_dance(archive, "hostile", lively(5, 90), title=HOSTILE)
    page = open_page("/?take=hostile")
    wait(page, DRAWN)
    assert "taken over" not in page.title()
    assert page.get_by_role("combobox").first.input_value().startswith(HOSTILE)


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


def test_a_damaged_take_is_told_and_the_others_searched(open_page, archive):
    for file in (archive / "takes" / "other").rglob("c/*/0/0"):
        if "position" in str(file):
            file.write_bytes(b"damaged")
    page = open_page("/?take=asked&clip=60-119", faults_expected=True)
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
