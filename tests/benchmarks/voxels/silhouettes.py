"""Measure silhouettes of eight generated cameras: `python -m tests.benchmarks.voxels.silhouettes`.

The peer is OpenCV's MOG2 with shadow detection, on the same frames, without any cleaning.
"""

import json
import sys
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.capture.backgrounds import make_background
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_silhouettes
from tests.benchmarks.history import keep_ratios

CAMERAS, FRAMES, ROWS, COLUMNS = 8, 30, 240, 320
REPEATS = 5


def make_film(seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the frames of one camera, a figure walking before a green wall, and its plate."""
    rng = np.random.default_rng(seed)
    wall = np.array([56.0, 122.0, 64.0]) * np.linspace(0.8, 1.1, COLUMNS)[None, :, None]
    wall = np.broadcast_to(wall, (ROWS, COLUMNS, 3))
    frames = []
    for n in range(FRAMES):
        frame = wall.copy()
        cv2.ellipse(frame, (100 + 3 * n, 140), (20, 70), 0, 0, 360, (130, 30, 120), -1)
        cv2.circle(frame, (100 + 3 * n, 60), 12, (190, 140, 120), -1)
        frames.append(cv2.GaussianBlur(frame, (3, 3), 0.7) * rng.uniform(0.95, 1.05))
    film = np.stack([wall, *frames]) + rng.normal(0, 2.5, (FRAMES + 1, ROWS, COLUMNS, 3))
    film = np.clip(np.rint(film), 0, 255).astype(np.uint8)
    return film[1:], film[0]


def milliseconds(work: Callable[[], object]) -> float:
    """Return the least processor time for a frame of all cameras, after a first run."""
    work()
    best = np.inf
    for _ in range(REPEATS):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return 1e3 * best / FRAMES * CAMERAS


def main() -> None:
    """Write one JSON object: processor milliseconds for a frame of eight cameras."""
    frames, plate = make_film()
    background = make_background(plate[None])
    rows = {}
    for rule in ("chroma", "crcb"):
        settings = SilhouetteSettings(rule=rule)
        rows[rule] = milliseconds(
            lambda settings=settings: extract_silhouettes(frames, background, settings)
        )
    peer = cv2.createBackgroundSubtractorMOG2(30, 25, detectShadows=True)
    rows["MOG2 (peer)"] = milliseconds(lambda: [peer.apply(frame, None, 0) for frame in frames])
    json.dump({"milliseconds_of_8_cameras": rows}, sys.stdout, indent=2)
    sys.stdout.write("\n")
    peer_ms = rows.pop("MOG2 (peer)")
    keep_ratios("silhouettes", {f"MOG2, {rule}": peer_ms / ms for rule, ms in rows.items()})


if __name__ == "__main__":
    main()
