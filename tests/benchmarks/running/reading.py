"""Benchmark of reading a BVH file, beside numpy reading nothing but its numbers.

Run with `make bench`, or `python -m tests.benchmarks.running.reading`. Times are the least
processor time of several rounds, turn by turn. What a reader adds to the numbers is checking and
kinematics.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from storage.formats.motion.bvh import read_bvh, write_bvh
from tests.benchmarks.history import keep_ratios

ROUNDS = 5
BONES, FRAMES, RATE_HZ = 40, 4000, 120.0
TARGET = 3.0
"""The most times as long as numpy's that reading may take. 2.0 to 2.1 were measured."""


def main() -> None:
    """Read the file by turns with both, and print one line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, help="by default a generated one of 4 MB")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = options.file or write_swaying(Path(folder, "swaying.bvh"))
        ours = peer = np.inf
        for _ in range(ROUNDS):
            ours = min(ours, processor_seconds(lambda: read_bvh(path)))
            peer = min(peer, processor_seconds(lambda: read_numbers(path)))
        megabytes = path.stat().st_size / 1e6
    sys.stdout.write(
        f"reading {megabytes:.1f} MB of BVH : numpy reading its numbers  {ours:.3f} s : "
        f"{peer:.3f} s = {ours / peer:.2f} (target <= {TARGET:g})\n"
    )
    keep_ratios("reading", {"numpy reading the numbers of BVH": peer / ours})


def write_swaying(path: Path) -> Path:
    """Write forty bones that sway, about 4 MB; return the path."""
    time_s = np.arange(FRAMES) / RATE_HZ
    rng = np.random.default_rng(5)
    turn = rng.uniform(-1, 1, (1, BONES, 3)) * np.sin(time_s)[:, None, None]
    rotation = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(FRAMES, BONES, 3, 3)
    root = np.stack([np.sin(time_s), 1 + 0 * time_s, np.cos(time_s)], axis=1)
    names, parents = [f"bone{n}" for n in range(BONES)], [(n - 1) // 2 for n in range(BONES)]
    parents[0] = -1
    offset = rng.uniform(-0.2, 0.2, (BONES, 3))
    write_bvh(path, names, parents, offset, root, rotation, RATE_HZ)
    return path


def read_numbers(path: Path) -> np.ndarray:
    """Return the numbers below a BVH file's header."""
    lines = path.read_text().split("MOTION", 1)[1].split("\n", 3)
    return np.array(lines[3].split(), np.float64)


def processor_seconds(work: Callable[[], Any]) -> float:
    """Return the processor time of a piece of work."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


if __name__ == "__main__":
    main()
