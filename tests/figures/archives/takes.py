"""Small takes written straight into an archive, whose every value tells their version."""

import multiprocessing
import os

import numpy as np

from storage import create_archive
from storage.arrays.groups import write_motion
from storage.arrays.search import write_search_array
from storage.provenance import recorded
from storage.publication import (
    describe_files,
    new_version,
    next_number,
    publish_record,
    version_folder,
)
from storage.records import Record
from storage.schema import JOINTS

FRAMES = 40


def write_version(place, take, *, frames=FRAMES):
    """Write a version of a take and return its record, not published yet."""
    number = next_number(place, take)
    version = new_version(place, take)
    with recorded("test", settings={"number": number}, inputs={}) as provenance:
        position = np.full((frames, len(JOINTS), 3), float(number), np.float32)
    write_motion(
        place,
        version_folder(take, version),
        position=position,
        filled=np.zeros(position.shape[:2], bool),
        rate_hz=30.0,
        attributes={"stature_m": None},
        provenance=provenance,
    )
    write_search_array(place, take, version, np.full((5, frames), float(number), np.float32))
    return Record(
        take=take,
        version=version,
        number=number,
        source={"kind": "bvh", "name": "a.bvh", "path": "/a.bvh", "digest": "d" * 64},
        metadata={"performer": "TK"},
        frames=frames,
        rate_hz=30.0,
        joints_present=list(JOINTS),
        stages=["motion"],
        files=describe_files(place, take, version),
    )


def publish(place, take, **options):
    """Write and publish a version of a take."""
    record = write_version(place, take, **options)
    publish_record(place, record)
    return record


def publish_until_killed(location, take, seconds):
    """Publish in a process of its own, kill that after so long, and return the last number told.

    None where it was killed before it published anything.
    """
    context = multiprocessing.get_context("forkserver")  # a start costs milliseconds
    context.set_forkserver_preload(["tests.figures.archives.takes"])
    reader, writer = context.Pipe(duplex=False)
    # the fork server keeps the environment that it was started in
    access = {name: value for name, value in os.environ.items() if name.startswith("AWS_")}
    process = context.Process(target=publish_for_ever, args=(location, take, writer, access))
    process.start()
    writer.close()
    process.join(timeout=seconds)
    process.kill()
    process.join()
    last = None
    while True:
        try:
            last = reader.recv()
        except EOFError:
            return last


def publish_for_ever(location, take, told, access):
    """Publish version after version, telling each number once it is published, until killed."""
    os.environ.update(access)
    place = create_archive(location).place
    while True:
        told.send(publish(place, take).number)
