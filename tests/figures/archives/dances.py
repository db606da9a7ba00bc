"""An archive whose dances are known: a movement of the feet that two takes share, a filmed one."""

from pathlib import Path

import numpy as np

from storage import create_archive
from storage.arrays.groups import write_motion
from storage.arrays.search import write_search_array
from storage.arrays.voxels import write_voxels
from storage.provenance import Provenance
from storage.publication import (
    describe_files,
    new_version,
    next_number,
    publish_record,
    version_folder,
)
from storage.records import Record
from storage.schema import JOINTS
from tasks.geometry.voxels import encode_runs, surface_voxels
from tasks.motion.stature import measure_stature
from tasks.retrieval.normalization import pack_motion
from tests.conftest import swaying_body

RATE_HZ = 30.0
SHARED = (60, 119)
"""The frames of the take "asked" whose feet are those of `ANSWER` too."""
ANSWER = (150, 209)
HOSTILE = '<script>document.title = "taken over"</script><img src=x onerror=alert(1)>'
SHAPE, VOXEL_M, ORIGIN_M = (22, 34, 12), 0.05, (-0.45, 0.025, -0.3)
WIDE, TALL, DEEP = 14, 32, 6
"""Size of the box that was filmed [voxels]."""
VOXELS = WIDE * TALL * DEEP
SURFACE = VOXELS - (WIDE - 2) * (TALL - 2) * (DEEP - 2)
_FEET = [k for k, name in enumerate(JOINTS) if name[1:] in ("Ankle", "Heel", "Foot")]
_REST = [k for k in range(len(JOINTS)) if k not in _FEET]


def dances():
    """Return the positions of each take, by its name."""
    asked, answer, other = (lively(seed, n) for seed, n in ((1, 240), (2, 300), (3, 260)))
    filmed = swaying_body(4, 60).astype(np.float32)
    shared = lively(9, 60)[:, _FEET]
    asked[SHARED[0] : SHARED[1] + 1, _FEET] = shared
    answer[ANSWER[0] : ANSWER[1] + 1, _FEET] = shared
    other[:, JOINTS.index("LFin")] = np.nan
    return {"asked": asked, "answer": answer, "other": other, "filmed": filmed}


def lively(seed, frames):
    """A body whose hips hold still, and whose joints sway wider the farther they are off."""
    body = swaying_body(seed, frames)
    hips = [JOINTS.index(side + "Hip") for side in "RL"]
    body[:, hips] = body[:, hips].mean(axis=0)
    rest = body.mean(axis=0)
    return (
        rest + (body - rest) * np.where(np.isin(range(len(JOINTS)), hips), 1, 4)[:, None]
    ).astype(np.float32)


def make_dances(location):
    """Make the archive; return its takes' positions by name."""
    create_archive(location)
    found = dances()
    for name, position in found.items():
        add_dance(location, name, position, filmed=name == "filmed")
    return found


def add_dance(location, name, position, *, filmed=False, title=None):
    """Publish a take, or another version of it."""
    place = create_archive(location).place
    number, version = next_number(place, name), new_version(place, name)
    folder = version_folder(name, version)
    stature = measure_stature(position, JOINTS)
    write_motion(
        place, folder, position=position, filled=np.zeros(position.shape[:2], bool),
        rate_hz=RATE_HZ, attributes={"stature_m": stature, "stature_source": "measured"},
        provenance=Provenance("importing", {}, {}),
    )  # fmt: skip
    write_search_array(place, name, version, pack_motion(position, RATE_HZ, stature))
    stages = ["motion"]
    if filmed:
        film(place, folder, len(position))
        stages += ["voxels", "labels"]
    present = np.isfinite(position).all(axis=2).mean(axis=0) >= 0.5
    publish_record(
        place,
        Record(
            name, version, number,
            {
                "kind": "capture" if filmed else "bvh", "name": "a", "digest": "d",
                "path": str(Path(location).parent / "capture"),
            },
            {"title": title or f"The {name}", "performer": "TK"}, len(position), RATE_HZ,
            [joint for joint, there in zip(JOINTS, present, strict=True) if there], stages,
            describe_files(place, name, version),
        ),
    )  # fmt: skip


def box(frame):
    """The voxels of a frame: a box as tall as a body that goes a voxel to +x each ten frames."""
    occupied = np.zeros(SHAPE, np.bool_)
    first = 2 + frame // 10
    occupied[first : first + WIDE, :TALL, 3 : 3 + DEEP] = True
    return occupied


def film(place, folder, frames):
    """Write voxels: red, blue above 1 m; Head above, Body below."""
    occupied = np.stack([box(frame) for frame in range(frames)])
    runs = encode_runs(occupied)
    surface = [surface_voxels(runs, frame) for frame in range(frames)]
    high = [np.argwhere(each)[:, 1] >= 20 for each in occupied]
    rgb = [np.where(h[:, None], [30, 40, 220], [220, 40, 30]).astype(np.uint8) for h in high]
    label = np.concatenate([np.where(h, 1, 2) for h in high]).astype(np.uint8)
    shown = [c[s] for c, s in zip(rgb, surface, strict=True)]
    write_voxels(
        place, folder,
        {
            "run": runs.offset,
            "voxel": np.cumsum([0, *map(len, surface)]),
            "surface": np.cumsum([0, *map(len, shown)]),
        },
        {
            "run_start": [runs.start], "run_length": [runs.length], "is_surface": surface,
            "label": [label], "provisional_label": [label], "color": shown,
            "camera": [np.zeros(len(each), np.uint8) for each in shown],
        },
        attributes={
            "origin_m": list(ORIGIN_M), "voxel_m": VOXEL_M, "shape": list(SHAPE),
            "provenance": Provenance("carving", {}, {}).attributes(),
        },
        array_attributes={}, rate_hz=RATE_HZ,
    )  # fmt: skip
