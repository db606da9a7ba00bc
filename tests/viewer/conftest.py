"""One viewer and one browser for the tests of a file."""

import os
import select
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from tests.conftest import HANGING_S, ROOT
from tests.figures.dances import make_dances

FLAGS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
"""WebGL by the processor: machines of the tests have no graphics card."""
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
"""The system's own, none that is downloaded."""
HANGING_MS = HANGING_S * 1000


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """An archive of the known dances: where it is."""
    location = tmp_path_factory.mktemp("viewer") / "archive"
    make_dances(location)
    return location


@pytest.fixture(scope="module")
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
    """Start a viewer of an archive, and end it."""
    command = [sys.executable, "-m", "flows.command.main", "view", str(location)]
    process = subprocess.Popen(
        [*command, "--port", "0", "--no-browser"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        assert select.select([process.stdout], [], [], HANGING_S)[0]
        yield Viewer(process.stdout.readline().strip().rstrip("/"), process)
    finally:
        process.terminate()
        process.wait(HANGING_S)
        process.stdout.close()


@pytest.fixture(scope="module")
def browser():
    """A Chromium; the tests that need one are skipped where there is none."""
    if CHROMIUM is None:
        pytest.skip("these tests need Chromium: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, viewer):
    """A function that opens a page of the viewer; nothing may go wrong on it, or leave loopback."""
    contexts, faults, strange = [], [], []

    def open_(address="/", *, faults_expected=False, **options):
        context = browser.new_context(
            **{"viewport": {"width": 1280, "height": 800}, "locale": "en", **options}
        )
        contexts.append(context)
        page = context.new_page()
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
    for context in contexts:
        context.close()
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


def poll(condition):
    """Wait until a function returns something true; return it."""
    deadline = time.monotonic() + HANGING_S
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found
