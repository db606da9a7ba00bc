"""Films that began late, or lost frames: what is said of them, and by how much it is wrong.

`python -m tests.benchmarks.voxels.offsets [CAPTURE ...]`, by default the shared captures. Each
camera in turn is late by 1, 3 and 8 frames, as if its film had been cut at the head, then lacks 1
and 3 frames in the middle. Silhouettes are found once; a line of JSON a case, and a table at the
end.
"""

import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from storage.formats.calibration.reading import read_calibration
from storage.formats.capture.capture import read_capture
from tasks.capture.empty_stages import read_backgrounds
from tasks.capture.films import projection_of, read_films
from tasks.capture.tangency import find_outline, find_touches
from tasks.checks.offsets import Beginnings, Passage, Timing, judge_beginnings, timing_of
from tasks.geometry.projection import Projection
from tasks.reconstruction.silhouettes import extract_silhouettes
from tests.benchmarks.recordings import data_folder

DATA = data_folder()
RENDERED = ("plain", "martial", "spin", "kimono")
LATE, LOST = (1, 3, 8), (1, 3)
LATE_FRAMES = 0.75
"""From how much lateness it is a fault, as `AgreementSettings` has it [frames]."""
RIG_TOML = """
[volume]
center_m = [0.1, 0.9, -0.3]
size_m = [2.0, 2.0, 2.0]
voxel_m = 0.02
[video]
fps = 50.0
up = "z"
unit = "mm"
"""


def capture_of_rig(into: Path) -> Path:
    """Lay the files of the rig `bini` out as a capture."""
    for name in ("videos", "background", "calibration"):
        (into / name).mkdir(parents=True)
    for camera in sorted((DATA / "rigs" / "bini").glob("cam?")):
        shutil.copy(camera / "video.avi", into / "videos" / f"{camera.name}.avi")
        shutil.copy(camera / "background.png", into / "background" / f"{camera.name}.png")
        shutil.copy(camera / "config.xml", into / "calibration" / f"{camera.name}.xml")
    (into / "capture.toml").write_text(RIG_TOML)
    return into


@dataclass(frozen=True)
class Films:
    """Silhouettes of a capture (time, camera, row, column / 8), of which frames can be chosen."""

    packed: NDArray[np.uint8]
    projection: Projection
    timing: Timing

    def judged(self, chosen: Sequence[NDArray[np.int64]]) -> Beginnings:
        """Say what is found where each camera shows the frames chosen."""
        count = min(map(len, chosen))
        outlines = [
            find_outline(self.packed[each[: count : self.timing.step], c], self.projection, c)
            for c, each in enumerate(chosen)
        ]
        passage = Passage(0, find_touches(outlines, self.projection))
        return judge_beginnings([passage], self.projection, self.timing)


def films_of(folder: Path) -> Films:
    """Return the silhouettes of all frames of a capture."""
    source = read_capture(folder)
    backgrounds = read_backgrounds(source)
    parts = [
        np.stack(
            [
                np.packbits(extract_silhouettes(film, background), axis=-1)
                for film, background in zip(films, backgrounds, strict=True)
            ],
            axis=1,
        )
        for _, films in read_films(source, 0, source.frames)
    ]
    timing = timing_of(source, LATE_FRAMES)
    return Films(np.concatenate(parts), projection_of(source.cameras), timing)


def dancer() -> Films:
    """Return the one instant of `dancer8`."""
    folder = DATA / "dancer8"
    pictures = sorted((folder / "silhouettes").glob("*.pbm"))
    seen = np.stack([np.asarray(cv2.imread(str(each), cv2.IMREAD_GRAYSCALE)) for each in pictures])
    rows, columns = seen.shape[1:]
    cameras = [
        replace(camera, size=(columns, rows))
        for camera in read_calibration(folder / "calibration")[0]
    ]
    timing = Timing([camera.name for camera in cameras], 30.0, 1, [0.0] * len(cameras), LATE_FRAMES)
    return Films(np.packbits(seen > 0, axis=-1)[None], projection_of(cameras), timing)


def cases(films: Films) -> Iterator[tuple[str, int, int, Beginnings, float]]:
    """Yield what is said of each case: kind, camera, frames, what was found, seconds."""
    every = np.arange(len(films.packed))
    cameras = range(len(films.timing.names))

    def judged(camera: int, own: NDArray[np.int64]) -> tuple[Beginnings, float]:
        begun = time.process_time()
        found = films.judged([own if c == camera else every for c in cameras])
        return found, time.process_time() - begun

    yield "together", -1, 0, *judged(-1, every)
    for frames in LATE:
        for camera in cameras if len(every) > frames else ():
            yield "late", camera, frames, *judged(camera, every[frames:])
    for frames in LOST:
        for camera in cameras if len(every) > frames else ():
            middle = np.arange(len(every) // 2, len(every) // 2 + frames)
            yield "lost", camera, frames, *judged(camera, np.delete(every, middle))


def row_of(kind: str, camera: int, frames: int, found: Beginnings) -> dict[str, object]:
    """Return how far what was found is right."""
    late = np.array(found.late_frames)
    truth = np.zeros(len(late))
    if kind == "late":
        truth[camera] = frames
    truth -= np.median(truth)
    known = ~np.isnan(late)
    bad = np.abs(np.nan_to_num(late)) >= LATE_FRAMES
    others = np.arange(len(late)) != camera
    lost = np.array(found.loses)
    return {
        "kind": kind,
        "camera": camera,
        "frames": frames,
        "found": bool((lost if kind == "lost" else bad)[camera]) if kind != "together" else None,
        "false": int((bad | lost)[others].sum()),
        "unknown": int((~known & ~lost).sum()),
        "error": None
        if kind == "lost" or not known.any()
        else round(float(np.abs(late - truth)[known].max()), 3),
        "said": [*found.faults, *found.notes],
    }


def table_of(name: str, rows: Sequence[dict[str, object]]) -> Iterator[str]:
    """Yield a line a kind of case."""
    for kind, frames in dict.fromkeys((row["kind"], row["frames"]) for row in rows):
        own = [row for row in rows if (row["kind"], row["frames"]) == (kind, frames)]
        errors = [row["error"] for row in own if isinstance(row["error"], float)]
        found = "" if kind == "together" else str(sum(bool(row["found"]) for row in own))
        false, unknown = (sum(int(str(row[key])) for row in own) for key in ("false", "unknown"))
        error = f"{max(errors):.2f}" if errors else "-"
        yield (
            f"{name:10} {kind:9} {frames:6} {len(own):6} {found:>6} {false:6} {unknown:8} "
            f"{error:>6}"
        )


def main() -> None:
    """Write a line of JSON a case to standard output, and a table to standard error."""
    head = "capture    kind      frames  cases  found  false  unknown  error"
    lines = [head]
    with tempfile.TemporaryDirectory() as folder:
        usual = [*(DATA / "captures" / name for name in RENDERED), Path(folder) / "bini"]
        if not sys.argv[1:]:
            capture_of_rig(usual[-1])
        looked_at = {path.name: partial(films_of, path) for path in map(Path, sys.argv[1:])}
        looked_at = looked_at or {
            **{path.name: partial(films_of, path) for path in usual}, "dancer8": dancer,
        }  # fmt: skip
        for name, read in looked_at.items():
            rows = []
            for kind, camera, frames, found, seconds in cases(read()):
                rows.append(row_of(kind, camera, frames, found))
                json.dump({"capture": name, **rows[-1], "seconds": seconds}, sys.stdout)
                sys.stdout.write("\n")
            lines += table_of(name, rows)
    sys.stderr.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
