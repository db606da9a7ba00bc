"""Pages on a slow line, in a browser without 3-D graphics, and of an archive of 10,000 takes."""

from dataclasses import replace
from pathlib import Path

import pytest

from storage import open_archive
from storage.records import record_content, record_path
from tests.figures.archives.dances import make_dances
from tests.viewer.conftest import CHROMIUM, DRAWN, FLAGS, LINK, PLAYING, VISITOR, open_viewer, wait

pytestmark = [pytest.mark.slow, pytest.mark.compiled, pytest.mark.long]

TAKES = 10_000
BLUE = (
    "() => { const c = document.querySelector('.stage-view canvas'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
    "let n = 0; for (let i = 0; i < d.length; i += 4) if (d[i + 2] - d[i] > 90) n++; return n; }"
)


def test_without_webgl_flat_figures_are_drawn_and_it_is_said(browser, viewer):
    flat = browser.browser_type.launch(executable_path=CHROMIUM, args=[*FLAGS, "--disable-webgl"])
    page = flat.new_page(**VISITOR)
    for address, drawn in ((LINK, PLAYING), ("/browse?take=filmed", DRAWN)):
        page.goto(viewer + address)
        wait(page, drawn)
        assert "no 3-D graphics" in page.locator(".stage-message").inner_text()
        assert page.evaluate(BLUE) > 100
    page.goto(viewer + "/body?take=filmed&frame=20")
    wait(page, "() => window.shosa?.bodyModel?.labels?.length > 0")
    flat.close()


def test_on_a_slow_line_waiting_is_shown_and_the_overlay_comes(open_page):
    page = open_page("/?take=asked&clip=0-30&part=feet")
    wait(page, DRAWN)
    page.evaluate(
        "() => { window.waited = []; new MutationObserver(() => { for (const s of ['.stage.waiting', '.progress:not(.empty)']) if (document.querySelector(s)) window.waited.push(s); })"
        ".observe(document.body, { subtree: true, attributes: true, attributeFilter: ['class'] }); }"
    )
    line = page.context.new_cdp_session(page)
    line.send("Network.enable")
    slow = {"offline": False, "latency": 400, "downloadThroughput": 20e3, "uploadThroughput": 20e3}
    line.send("Network.emulateNetworkConditions", slow)
    page.click("[data-control=search]")
    wait(page, PLAYING)
    assert {*page.evaluate("() => window.waited")} == {".stage.waiting", ".progress:not(.empty)"}


def test_of_ten_thousand_takes_some_are_listed_and_a_filter_finds_one(browser, tmp_path):
    location = tmp_path / "archive"
    make_dances(location)
    record = open_archive(location).take("asked").record
    for number in range(TAKES):
        each = replace(record, take=f"z{number:05d}", metadata={"title": f"Dance {number:05d}"})
        file = Path(location, record_path(each.take, 1))
        file.parent.mkdir()
        file.write_bytes(record_content(each))
    with open_viewer(location) as opened:
        context = browser.new_context(**VISITOR)
        page = context.new_page()
        asked = []
        page.goto(opened.url + "/browse?take=asked")
        wait(page, DRAWN)
        assert "10,004 recordings" in page.locator(".takes-head small").inner_text()
        page.on("request", lambda request: asked.append(request.url))
        assert page.locator(".take").count() == 80
        page.fill("[data-control=filter]", "dance 09876")
        wait(page, "() => document.querySelectorAll('.take').length === 1")
        assert page.locator(".take b").inner_text() == "Dance 09876"
        assert page.evaluate("() => document.querySelectorAll('*').length") < 1000
        assert asked == []  # what is listed comes over the line that is open
        page.goto(opened.url + "/?take=asked")
        wait(page, DRAWN)
        chooser = page.get_by_role("combobox", name="Recording")
        chooser.click()
        wait(page, "() => document.querySelectorAll('.chooser-option').length === 60")
        chooser.fill("dance 01234")
        wait(page, "() => document.querySelectorAll('.chooser-option').length === 1")
        context.close()
