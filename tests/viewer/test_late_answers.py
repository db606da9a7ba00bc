"""Answers that come late: what was asked for since stays."""

import threading
from contextlib import contextmanager
from functools import partial

import pytest
import uvicorn

from tests.conftest import HANGING_S
from tests.figures.archives.dances import SHARED
from tests.viewer.conftest import DRAWN, PLAYING, poll, wait
from viewer.pages.turns import Turns

pytestmark = [pytest.mark.slow, pytest.mark.compiled]

CHOSEN = "() => document.querySelector('.chooser input').value"


def test_only_the_newest_of_a_kind_has_its_turn():
    turns = Turns()
    first, other = turns.take("recording"), turns.take("filter")
    assert first()
    assert other()
    second = turns.take("recording")
    assert not first()
    assert second()
    assert other()


class Gate:
    """Lets nobody through until it is opened, and knows who has come and gone."""

    def __init__(self):
        self.came, self.open, self.left = (threading.Event() for _ in range(3))

    def pass_(self, act):
        """Wait at the gate, then act."""
        self.came.set()
        assert self.open.wait(HANGING_S)
        try:
            return act()
        finally:
            self.left.set()


@pytest.fixture(scope="module")
def viewer(archive, tmp_path_factory):
    """A viewer inside this process, in which answers can be held back."""
    from viewer.digitizing import Digitizations
    from viewer.guard import guard
    from viewer.holdings import Holdings
    from viewer.pages.shell import Site
    from viewer.serving import make_app, quiet_libraries

    quiet_libraries()
    folder = tmp_path_factory.mktemp("uploads")
    holdings = Holdings(str(archive), folder)
    app = make_app(Site(holdings, "http://127.0.0.1:4200"), Digitizations(None, folder))
    server = uvicorn.Server(
        uvicorn.Config(guard(app, "127.0.0.1"), port=0, log_level="error", ws="websockets-sansio")
    )
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    port = poll(lambda: server.started and server.servers[0].sockets[0].getsockname()[1])
    yield f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join(HANGING_S)


@contextmanager
def held_back(monkeypatch, take):
    """Hold back the motion of a take."""
    from viewer.holdings import Holdings

    gate, read = Gate(), Holdings.motion

    def motion(self, name, version=None):
        act = partial(read, self, name, version)
        return gate.pass_(act) if name == take and version is None else act()

    monkeypatch.setattr(Holdings, "motion", motion)
    yield gate
    gate.open.set()


def choose(page, take):
    """Choose a recording as a visitor does."""
    chooser = page.get_by_role("combobox", name="Recording")
    chooser.click()
    chooser.fill(take)
    wait(
        page,
        "take => document.querySelectorAll('.chooser-option').length === 1 && document.querySelector(`[data-take=${take}]`)",
        take,
    )
    page.keyboard.press("Enter")


def answered(page):
    """Wait until the page has had an answer to a later question."""
    page.click("[data-part=hands]")
    wait(page, "() => document.querySelector('[data-part=hands]').ariaPressed === 'true'")


@pytest.mark.long
def test_a_recording_that_is_read_late_does_not_replace_one_chosen_since(open_page, monkeypatch):
    page = open_page("/?take=asked")
    wait(page, DRAWN)
    with held_back(monkeypatch, "other") as gate:
        choose(page, "other")
        assert gate.came.wait(HANGING_S)
        choose(page, "answer")
        wait(page, "() => window.shosa.score.query.take === 'answer'")
        gate.open.set()
        assert gate.left.wait(HANGING_S)
        answered(page)
    assert page.evaluate("() => window.shosa.score.query.take") == "answer"
    assert page.evaluate(CHOSEN).startswith("The answer")


@pytest.mark.long
def test_what_the_page_begins_with_does_not_replace_what_is_chosen(open_page, monkeypatch):
    with held_back(monkeypatch, "other") as gate:
        page = open_page("/?take=other&search=yes")
        assert gate.came.wait(HANGING_S)
        choose(page, "answer")
        wait(page, "() => window.shosa.score?.query?.take === 'answer'")
        gate.open.set()
        assert gate.left.wait(HANGING_S)
        answered(page)
    assert page.evaluate("() => window.shosa.score.query.take") == "answer"
    assert page.locator(".result").count() == 0


@pytest.mark.long
def test_a_search_that_ends_late_changes_nothing_that_was_asked_since(open_page, monkeypatch):
    import viewer.pages.search as search

    gate, find = Gate(), search.find_others
    monkeypatch.setattr(search, "find_others", lambda *a, **k: gate.pass_(lambda: find(*a, **k)))
    page = open_page(f"/?take=asked&clip={SHARED[0]}-{SHARED[1]}&part=feet")
    wait(page, DRAWN)
    page.click("[data-control=search]")
    assert gate.came.wait(HANGING_S)
    field = page.locator("[data-field=first]")
    field.fill("10")
    field.press("Enter")
    wait(page, "() => window.shosa.score.query.start === 10")
    gate.open.set()
    wait(
        page,
        "() => document.querySelector('.outdated') && document.querySelectorAll('.result').length > 0",
    )
    answered(page)
    assert page.evaluate("() => [window.shosa.score.query.start, window.shosa.score.match]") == [
        10,
        None,
    ]
    page.click("[data-control=search]")
    wait(page, PLAYING)
    assert page.locator(".outdated").count() == 0


@pytest.mark.long
def test_a_file_and_frames_that_come_late_replace_nothing(open_page, write_walk, tmp_path):
    page = open_page("/?take=asked")
    wait(page, DRAWN)
    held = []
    page.route("**/files?*", lambda route: held.append(route))
    page.set_input_files("input[type=file]", write_walk(tmp_path / "walk.trc", seed=7))
    poll(lambda: held or page.wait_for_timeout(10))
    page.route("**/data/track/other/*", lambda route: held.append(route))
    choose(page, "other")
    poll(lambda: len(held) > 1 or page.wait_for_timeout(10))
    choose(page, "answer")
    wait(
        page,
        "() => window.shosa.stage.figures[0]?.pose && window.shosa.score.query.take === 'answer'",
    )
    with page.expect_response("**/files?*"):
        held.pop(0).continue_()
    for each in held:
        each.continue_()
    answered(page)
    assert page.evaluate("() => window.shosa.score.query.take") == "answer"
    assert page.evaluate(CHOSEN).startswith("The answer")


def test_what_a_search_has_found_is_listed_while_it_goes_on(open_page, monkeypatch):
    import viewer.pages.search as search

    gate, find = Gate(), search.find_others

    def tell_early(*given, tell, **more):
        answer = find(*given, **more)
        tell(answer.matches[:2], 1)
        return gate.pass_(lambda: answer)

    monkeypatch.setattr(search, "find_others", tell_early)
    page = open_page(f"/?take=asked&clip={SHARED[0]}-{SHARED[1]}")
    wait(page, DRAWN)
    page.click("[data-control=search]")
    assert gate.came.wait(HANGING_S)
    wait(page, "() => document.querySelectorAll('.result').length === 2")
    assert page.locator(".result.open").count() == 1
    assert "1 of them certain" in page.locator(".found-head").inner_text()
    page.click(".result >> nth=0")  # nothing can be chosen of what may still change
    gate.open.set()
    wait(page, PLAYING)
    assert page.locator(".result.open").count() == 0
    assert page.locator(".result").count() > 2
