"""One viewer and one browser for all tests that do not change the archive."""

import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from tests.conftest import HANGING_S, ROOT
from tests.figures.archives.dances import SHARED, make_dances

FLAGS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader")
"""WebGL by the processor: machines of the tests have no graphics card."""
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
"""The system's own, none that is downloaded."""
HANGING_MS = HANGING_S * 1000
VISITOR = {"viewport": {"width": 1280, "height": 800}, "locale": "en"}


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
    """An archive of the known dances, which no test changes: where it is."""
    location = tmp_path_factory.mktemp("viewer") / "archive"
    make_dances(location)
    return location


@pytest.fixture(scope="session")
def viewer(archive):
    """The address of a viewer of the archive."""
    with open_viewer(archive) as opened:
        yield opened.url


@dataclass(frozen=True)
class Viewer:
    """A viewer in a process of its own, as `shosa view` starts it."""

    url: str
    process: subprocess.Popen


@contextmanager
def open_viewer(location):
    """Start a viewer of an archive, and end it: nothing of what visitors uploaded is left."""
    command = [sys.executable, "-m", "flows.command.main", "view", str(location)]
    with tempfile.TemporaryDirectory() as uploads:
        process = subprocess.Popen(
            [*command, "--port", "0", "--no-browser"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": uploads},
        )
        try:
            assert select.select([process.stdout], [], [], HANGING_S)[0]
            yield Viewer(process.stdout.readline().strip().rstrip("/"), process)
            assert os.listdir(uploads)
        finally:
            process.terminate()
            ended = process.wait(HANGING_S)
            process.stdout.close()
        assert (ended, os.listdir(uploads)) == (0, [])


@pytest.fixture(scope="session")
def browser():
    """A Chromium; the tests that need one are skipped where there is none."""
    if CHROMIUM is None:
        pytest.skip("these tests need Chromium: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def visitor(browser):
    """One visitor, whose browser has the scripts of the pages from the page before."""
    context = browser.new_context(**VISITOR)
    yield context
    context.close()


@pytest.fixture
def open_page(browser, visitor, viewer):
    """A function that opens a page of the viewer; nothing may go wrong on it, or leave loopback."""
    opened, faults, strange = [], [], []

    def open_(address="/", *, faults_expected=False, **options):
        context = visitor
        if options:  # somebody who has been here never before
            context = browser.new_context(**{**VISITOR, **options})
            opened.append(context)
        page = context.new_page()
        opened.append(page)
        page.set_default_timeout(HANGING_MS)
        if not faults_expected:
            page.on("console", lambda m: faults.append(m.text) if m.type == "error" else None)
            page.on("pageerror", lambda error: faults.append(str(error)))
        page.on(
            "request",
            lambda r: (
                None
                if r.url.startswith((viewer, "data:", "blob:", "file:"))
                else strange.append(r.url)
            ),
        )
        page.goto(viewer + address)
        return page

    yield open_
    for each in reversed(opened):
        each.close()
    assert not faults
    assert not strange


def wait(page, expression, argument=None):
    """Wait until an expression is true in the page; return it."""
    return page.wait_for_function(expression, arg=argument, timeout=HANGING_MS).json_value()


def poses(page):
    """Return what is drawn: the joints (joint, 3) of each figure, by `query` and `match`."""
    import numpy as np

    found = page.evaluate(
        "() => window.shosa.stage.figures.map(f => [f.who, f.pose && [...f.pose], f.frame])"
    )
    return {
        who: (np.array([np.nan if v is None else v for v in pose]).reshape(-1, 3), frame)
        for who, pose, frame in found
        if pose
    }


LINK = f"/?take=asked&clip={SHARED[0]}-{SHARED[1]}&part=feet&search=yes"
DRAWN = "() => window.shosa?.stage?.figures?.[0]?.pose"
PLAYING = "() => window.shosa?.stage?.figures?.length === 2 && window.shosa.stage.figures.every(f => f.pose)"


def opened(open_page, address=LINK, **options):
    """Return a page on which the best match dances over the query, paused at its beginning."""
    page = open_page(address, **options)
    wait(page, PLAYING)
    page.evaluate("() => document.activeElement.blur()")
    page.click("[data-control=play]")
    page.keyboard.press("Home")
    wait(page, "() => window.shosa.stage.figures[0].frame === " + str(SHARED[0]))
    return page


def drawn_frames(page):
    """Return the frames of the takes that are drawn, of query and match."""
    return [round(frame) for _, frame in poses(page).values()]


def poll(condition):
    """Wait until a function returns something true; return it."""
    deadline = time.monotonic() + HANGING_S
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found
