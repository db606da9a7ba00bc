"""A body model that was corrected on its page, and the digitization that it is used by."""

import os
import subprocess
import sys

import numpy as np
import pytest

from storage import open_archive
from storage.formats.capture.initial import read_initial
from storage.schema import SEGMENTS
from tests.conftest import HANGING_S, ROOT
from tests.figures.posed_captures import film_posed
from tests.viewer.conftest import open_viewer, poll, wait

pytestmark = [pytest.mark.slow, pytest.mark.compiled, pytest.mark.long]


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A small capture that begins with the arms stretched, so that it gets a pose."""
    return film_posed(tmp_path_factory.mktemp("films") / "posed")


@pytest.fixture(scope="module")
def archive(capture, tmp_path_factory):
    """An archive with the capture in it, digitized without a word of anybody."""
    folder = tmp_path_factory.mktemp("corrected")
    os.environ["PREFECT_HOME"] = str(folder / "home")
    command = [sys.executable, "-m", "flows.command.main", "ingest", str(folder / "archive")]
    subprocess.run([*command, str(capture)], cwd=ROOT, check=True, timeout=HANGING_S)
    yield folder / "archive"
    del os.environ["PREFECT_HOME"]


@pytest.fixture(scope="module")
def viewer(archive):
    """The address of a viewer of that archive."""
    with open_viewer(archive) as opened:
        yield opened.url


def test_what_is_corrected_on_the_page_is_what_the_take_is_digitized_by(
    open_page, archive, capture
):
    before = open_archive(archive).take("posed")
    assert before.record.number == 1
    page = open_page("/body?take=posed", faults_expected=True)
    wait(page, "() => window.shosa?.bodyModel?.labels?.length > 0")
    shares = page.evaluate("() => window.shosa.bodyModel.shares")
    page.locator("[data-joint=RElbow]").focus()
    for _ in range(2):  # some 5 cm
        page.keyboard.press("Shift+ArrowRight")
    lower = SEGMENTS.index("RForeArm")
    wait(
        page,
        "([k, share]) => Math.abs(window.shosa.bodyModel.shares[k] - share) > 0.0005",
        [lower, shares[lower]],
    )
    page.click("[data-control=save]")
    wait(page, "() => document.querySelector('[data-saved]').textContent.includes('Saved')")
    saved = read_initial(capture / "initial.json")
    page.click("[data-control=digitize]")
    wait(page, "() => document.querySelector('[data-work]')?.textContent.includes('Digitized')")
    after = poll(lambda: open_archive(archive).take("posed"))
    assert after.record.number == 2
    assert any("placed by a person" in note for note in after.record.notes)
    there = np.isfinite(saved.position).all(axis=1)
    found = np.asarray(after.body["initial_joint"].values)
    np.testing.assert_allclose(found[there], saved.position[there], atol=1e-3)
    first = np.asarray(before.body["initial_joint"].values)
    assert np.abs(found - first)[there].max() > 0.01
    page.click("[data-work] a")
    wait(
        page,
        "() => location.pathname === '/browse' && document.querySelector('.about')?.textContent.includes('placed by a person')",
    )
