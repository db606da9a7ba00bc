"""Bytes, seconds and memory of the viewer, with Chromium.

Pages are drawn by the processor (SwiftShader), so frames a second are those of a machine without a
graphics card.
"""

import gzip
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from storage import create_archive
from tests.figures.archives.dances import RATE_HZ, add_dance, lively
from tests.viewer.conftest import CHROMIUM, FLAGS, open_viewer
from viewer.tracks import make_palette, pack_track, pack_voxel_frame

TAKES, FRAMES = 50, 20_000
"""A million frames."""
VISITS = 100
BODY_VOXELS = 60_000
PLAYING = (
    "() => window.shosa?.stage?.figures?.length === 2 "
    "&& window.shosa.stage.figures.every(f => f.pose)"
)


def tell(line: str) -> None:
    """Write a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Measure, and print a line each."""
    tell(f"track, 60 s at 120 Hz: {track_bytes() / 1e6:.2f} MB")
    tell(f"voxels, a frame of a body of {BODY_VOXELS:,}: {voxel_bytes() / 1e3:.1f} kB")
    with tempfile.TemporaryDirectory() as folder:
        location = Path(folder) / "archive"
        create_archive(location)
        for number in range(TAKES):
            add_dance(location, f"take{number:03d}", lively(number, FRAMES), filmed=False)
        with open_viewer(location) as address, sync_playwright() as playwright:
            server = address.process
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            seconds, searched, rate = overlay_seconds(browser, address.url)
            tell(
                f"Search to playing overlay, {TAKES * FRAMES:,} frames: {seconds:.2f} s, of which "
                f"the search {searched:.2f} s; {rate:.0f} frames/s are drawn"
            )
            before = resident_mb(server)
            for _ in range(VISITS):
                visit(browser, address.url)
            time.sleep(15)  # longer than a page that was left is kept
            tell(f"server: {before:.0f} MB, after {VISITS} visits {resident_mb(server):.0f} MB")
            browser.close()


def track_bytes() -> int:
    """Return the bytes of a minute of joints that sway as those of a dancer."""
    time_s = np.arange(7200)[:, None, None] / 120
    rng = np.random.default_rng(0)
    position = np.zeros((7200, 21, 3))
    for speed in (0.3, 1.0, 2.3, 5.0):
        phase = rng.uniform(0, 6, (1, 21, 3))
        position += np.sin(2 * np.pi * speed * time_s + phase) * 0.3 / speed
    position += rng.normal(0, 0.0005, position.shape)  # half a millimeter of noise
    pieces = [pack_track(position[n : n + 512], n, 1) for n in range(0, 7200, 512)]
    return sum(len(gzip.compress(piece, 6)) for piece in pieces)


def voxel_bytes() -> float:
    """Return the bytes of a frame of a body of noisy colors: an ellipsoid of 1 cm voxels."""
    shape = (60, 180, 60)
    axes = np.indices(shape).reshape(3, -1).T
    tall = BODY_VOXELS / (4 / 3 * np.pi * 12.5**2)
    off = ((axes - [30, 90, 30]) / [12.5, tall, 12.5]) ** 2
    inside = (off.sum(axis=1) <= 1).reshape(shape)
    core = inside.copy()
    for axis in range(3):
        core &= np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    number = np.flatnonzero(inside & ~core)
    height = np.unravel_index(number, shape)[1]
    rng = np.random.default_rng(0)
    color = np.clip(120 + height[:, None] / 2 + rng.normal(0, 12, (len(number), 3)), 0, 255)
    color = color.astype(np.uint8)
    _, place = make_palette(color)
    chosen = place[(color >> 3).astype(int) @ [1024, 32, 1]]
    packed = pack_voxel_frame(0, number, chosen, (height // 17).astype(np.uint8))
    return len(gzip.compress(packed, 6))


def overlay_seconds(browser, address: str) -> tuple[float, float, float]:
    """Return seconds from Search to the overlay, those of the search alone, and frames a second."""
    page = browser.new_page(viewport={"width": 1280, "height": 800}, locale="en")
    page.goto(f"{address}/?take=take007&clip=5000-5060&part=feet")
    page.wait_for_function("() => window.shosa?.stage?.figures?.[0]?.pose", timeout=600_000)
    page.click("[data-control=search]")  # once, so that both kernels and files are warm
    page.wait_for_function(PLAYING, timeout=600_000)
    page.get_by_role("button", name="Legs", exact=True).click()
    page.wait_for_function("() => window.shosa.stage.figures.length === 1", timeout=600_000)
    begun = time.perf_counter()
    page.click("[data-control=search]")
    page.wait_for_function(PLAYING, timeout=600_000)
    seconds = time.perf_counter() - begun
    text = page.locator(".found-head [aria-live]").inner_text()
    drawn = page.evaluate("() => window.shosa.stage.frames")
    time.sleep(3)
    rate = (page.evaluate("() => window.shosa.stage.frames") - drawn) / 3
    page.close()
    return seconds, float(text.split("·")[-1].split()[0]), rate


def visit(browser, address: str) -> None:
    """Open the search page, wait for a figure, and leave."""
    page = browser.new_page()
    page.goto(f"{address}/?take=take001")
    page.wait_for_function("() => window.shosa?.stage?.figures?.[0]?.pose", timeout=600_000)
    page.close()


def resident_mb(process) -> float:
    """Return the memory of a process, MB."""
    text = Path(f"/proc/{process.pid}/status").read_text()
    (line,) = (line for line in text.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1e3


if __name__ == "__main__":
    assert RATE_HZ == 30.0
    main()
