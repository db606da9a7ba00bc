"""Browse and body-model pages and the report in a browser; who may ask; how `view` starts."""

import socket
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest

from flows.command.main import BAD_INPUT, DONE, RUN_FAILED, WRONG_USE, main
from storage.formats.capture.initial import read_initial
from storage.schema import JOINTS
from tests.conftest import ROOT
from tests.figures.archives.dances import SHARED, VOXELS
from tests.viewer.conftest import DRAWN, wait

pytestmark = [pytest.mark.slow, pytest.mark.compiled]


def test_recordings_are_browsed_filtered_and_followed_to_a_search(open_page):
    page = open_page("/browse")
    wait(page, DRAWN)
    assert page.locator(".take").count() == 4
    page.fill("[data-control=filter]", "filmed")
    wait(page, "() => document.querySelectorAll('.take').length === 1")
    page.click(".take")
    wait(page, "() => window.shosa.stage.bodies?.[0]?.count > 0")
    assert page.locator(".about dd").first.inner_text() == "filmed"
    page.fill("[data-control=filter]", "no such dance")
    wait(page, "() => document.body.textContent.includes('No recording has all these words')")
    with page.expect_download() as download:
        page.click("[data-link=bvh]")
    assert "HIERARCHY" in download.value.path().read_text()
    page.click("[data-link=search]")
    wait(page, "() => location.pathname === '/' && window.shosa?.score?.query?.take === 'filmed'")


def test_a_joint_is_dragged_the_labels_follow_and_the_model_is_saved(open_page, capture):
    page = open_page("/body?take=filmed&frame=20", faults_expected=True)
    wait(page, "() => window.shosa?.bodyModel?.labels?.length > 0")
    before = page.evaluate("() => window.shosa.bodyModel.joints")
    shares = page.evaluate("() => window.shosa.bodyModel.shares")
    page.click("[data-view=front]")
    drag(page, page.locator("[data-joint=RKnee] circle"), 0, 30)
    wait(
        page,
        "y => window.shosa.bodyModel.joints[10][1] < y - 0.02",
        before[JOINTS.index("RKnee")][1],
    )
    after = page.evaluate("() => window.shosa.bodyModel.joints")
    right, left = (
        np.subtract(after[JOINTS.index(s + "Knee")], before[JOINTS.index(s + "Knee")]) for s in "RL"
    )
    assert right[1] == pytest.approx(left[1])  # both sides together
    # the labels come with a later answer than the joints
    changed = "shares => JSON.stringify(window.shosa.bodyModel.shares) !== JSON.stringify(shares)"
    wait(page, changed, shares)
    page.click("[data-control=undo]")
    wait(
        page,
        "shares => JSON.stringify(window.shosa.bodyModel.shares) === JSON.stringify(shares)",
        shares,
    )
    page.click("[data-move=boundaries]")
    drag(page, page.locator("[data-joint=RKnee] rect"), 0, -25)
    wait(page, "() => window.shosa.bodyModel.bounds.RKnee && window.shosa.bodyModel.shares[8] > 0")
    page.click("[data-control=save]")
    wait(page, "() => document.querySelector('[data-saved]').textContent !== ''")
    assert "Saved" in page.locator("[data-saved]").inner_text()
    saved = read_initial(capture / "initial.json")
    assert saved.frame == 20
    np.testing.assert_allclose(saved.position, before, atol=1e-3)  # the boundary moved, no joint
    assert saved.label is not None
    assert len(saved.label) == VOXELS
    (capture / "initial.json").write_text('{"joints": {}}')  # somebody else
    page.click("[data-control=save]")
    wait(page, "() => document.querySelector('[data-saved]').textContent.includes('somebody else')")


def drag(page, handle, dx, dy):
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


@pytest.fixture
def capture(archive):
    """The folder of the capture that the filmed take is said to be from."""
    folder = archive.parent / "capture"
    folder.mkdir(exist_ok=True)
    return folder


def test_a_take_that_was_not_filmed_has_no_body_model(open_page):
    page = open_page("/body?take=asked")
    wait(page, "() => document.querySelector('.notice')?.textContent.includes('was not filmed')")


def test_films_that_are_kept_elsewhere_are_told(open_page):
    page = open_page("/browse?take=filmed")
    wait(
        page,
        "() => /films are not here|no folder/.test(document.querySelector('.films')?.textContent)",
    )


def test_the_report_plays_from_disk_without_network(open_page, archive, tmp_path, capsys):
    file = tmp_path / "report.html"
    query = f"asked:{SHARED[0]}-{SHARED[1]}"
    assert main(["report", str(archive), query, str(file), "--part", "feet", "--top", "4"]) == DONE
    assert "4 matches" in capsys.readouterr().err
    assert file.stat().st_size < 3e6
    page = open_page("/look/viewer.css")
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    wait(page, "() => window.shosaReport?.figures?.length === 2 && window.shosaReport.playing")
    assert asked == [file.as_uri()]
    first, second = page.evaluate("() => window.shosaReport.figures.map(f => [...f.pose])")
    feet = [JOINTS.index(side + end) for side in "RL" for end in ("Heel", "Foot")]
    apart = np.linalg.norm(np.subtract(first, second).reshape(-1, 3), axis=1)
    assert apart[feet].max() < 0.02
    page.locator("[data-rank='3']").click()
    wait(page, "() => window.shosaReport.chosen === 2")
    content = file.read_text("utf-8")
    assert "http://" not in content.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in content


def ask(address, **headers):
    request = urllib.request.Request(
        address, headers={k.replace("_", "-"): v for k, v in headers.items()}
    )
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "no-cors"},
    ],
    ids=["another-name", "another-page", "a-page-without-origin", "a-picture-elsewhere"],
)
@pytest.mark.parametrize(
    "path", ["/", "/look/viewer.css", "/_nicegui_ws/socket.io/?EIO=4&transport=polling"]
)
def test_another_site_can_neither_read_nor_do_anything(viewer, path, headers):
    assert ask(viewer + path)[0] in (200, 400)
    status, content = ask(viewer + path, **headers)
    assert status == 403
    assert b"answers to its own" in content


def test_another_site_opens_no_web_socket(viewer):
    host, port = viewer.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall(
            f"GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: {host}:{port}\r\n"
            "Origin: http://evil.example\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert b"403" in connection.recv(200).split(b"\r\n")[0]


def test_frames_that_are_not_there_are_told(viewer):
    for path, told in (
        ("/data/track/nobody/v?start=0&end=9", b"no take"),
        ("/data/track/asked/old?start=0&end=9", b"newer version"),
        ("/data/voxels/asked/x", b"newer version"),
        ("/export/nobody.bvh", b"no take"),
        ("/report?take=nobody", b"no take"),
    ):
        status, content = ask(viewer + path)
        assert status in (404, 409)
        assert told in content


@pytest.mark.long
def test_what_is_no_archive_or_port_is_told(tmp_path, capsys, archive):
    assert main(["view", str(tmp_path / "none"), "--no-browser"]) == BAD_INPUT
    assert "none" in capsys.readouterr().err
    assert main(["view", str(archive), "--port", "99999"]) == WRONG_USE
    assert main(["report", str(archive), "asked", str(tmp_path / "a.txt")]) == WRONG_USE
    assert main(["view", str(archive), "--runs", "dashboard"]) == WRONG_USE
    assert "--runs dashboard should be an address" in capsys.readouterr().err
    assert main(["serve", str(archive), "--viewer", "here"]) == WRONG_USE
    assert "--viewer here should read" in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = subprocess.run(
            [sys.executable, "-m", "flows.command.main", "view", str(archive), "--port", port, "--no-browser"],
            capture_output=True, text=True, cwd=ROOT, check=False,
        )  # fmt: skip
    assert done.returncode == RUN_FAILED
    assert "is taken" in done.stderr
