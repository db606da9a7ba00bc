"""Takes that have a record and a search array and nothing else, and a plain copy of them."""

import json
import os
import shutil

import numpy as np

from storage import open_archive
from storage.arrays.search import lying_search_arrays, write_search_array
from storage.index.segments import FOLDER
from storage.publication import new_version, next_number, publish_record
from storage.records import Record
from storage.schema import JOINTS
from tasks.retrieval.opening import open_segments, read_lying_takes

ROWS = 69
MANIFEST = "[0-9]" * 8 + ".json"
"""Which files are manifests [pattern]."""


class PlainTakes:
    """An archive, and what should be in it as a dict of arrays."""

    def __init__(self, place):
        self.place = place
        self.location = str(place.location)
        self.rows = {}
        self.versions = {}

    def publish(self, take, samples, *, metadata=None):
        """Publish a version of a take with rows that no other has."""
        number, version = next_number(self.place, take), new_version(self.place, take)
        rng = np.random.default_rng(int.from_bytes(version.encode(), "little"))
        self.rows[take] = rng.normal(size=(ROWS, samples)).astype(np.float32)
        self.versions[take] = version
        write_search_array(self.place, take, version, self.rows[take])
        publish_record(self.place, record_of(take, version, number, samples, metadata))

    def write_again(self):
        """Write the search arrays of all takes anew, as `shosa index` does."""
        for take, rows in self.rows.items():
            write_search_array(self.place, take, self.versions[take], rows)

    def remove(self, take):
        """Remove the records of a take by hand."""
        shutil.rmtree(self.place.folder / "published" / take)
        del self.rows[take], self.versions[take]

    def check(self, found=None, *, without=()):
        """Compare with what a search reads, value by value."""
        found, skipped = read_all(self.location) if found is None else found
        assert sorted(found) == sorted({*self.rows} - {*without})
        for take, rows in found.items():
            np.testing.assert_array_equal(rows, self.rows[take])
        assert {*skipped} == {*without}


def record_of(take, version, number, samples, metadata=None):
    """A record of a take of a motion at 30 Hz."""
    return Record(
        take=take,
        version=version,
        number=number,
        source={"kind": "bvh", "name": "a.bvh", "path": "/a.bvh", "digest": "d" * 64},
        metadata=metadata or {"performer": "TK", "title": f"所作 {version}"},
        frames=samples,
        rate_hz=30.0,
        joints_present=list(JOINTS[: 10 + samples % 5]),
        stages=["motion"],
        files={},
    )


def read_all(location, listing=None):
    """Return the rows of every take as a search reads them, and why others are not read."""
    archive = open_archive(location)
    listing = listing or archive.listing()
    wanted = {entry.take: entry.version for entry in listing.entries}
    opened, faults = open_segments(archive.place, listing.snapshot.labels, wanted)
    found, skipped, segments = {}, {}, []
    for each in opened:
        left = each
        while True:
            try:
                for _, first, samples in _searched(left.segment):
                    left.segment.check(first, first + samples)
            except ValueError as error:
                left, lost = left.without_damage(error)
                skipped |= lost
                continue
            break
        segments.append(left.segment)
    held = {name for segment in segments for name, _, _ in _searched(segment)} | {*skipped}
    lying = [entry for entry in listing.entries if entry.take not in held]
    for segment, faults_of_lying in read_lying_takes(archive.place, lying):
        segments += [segment] if segment is not None else []
        skipped |= {take: faults.get(take, why) for take, why in faults_of_lying.items()}
    for segment in segments:
        for place, (name, first, samples) in enumerate(_searched(segment)):
            assert name not in found
            assert first % 16 == 0, place
            assert np.isnan(segment.rows[:, first + samples]).all()
            found[name] = np.array(segment.rows[:, first : first + samples])
    return found, skipped


def _searched(segment):
    """The name, first sample and length of the takes that are searched."""
    return [
        (name, int(first), int(samples))
        for name, first, samples, is_searched in zip(
            segment.names, segment.first, segment.samples, segment.searched, strict=True
        )
        if is_searched
    ]


def lying(takes):
    return {take for take, _ in lying_search_arrays(takes.place)}


def files(takes, pattern="*"):
    return sorted(takes.place.folder.glob(f"{FOLDER}/{pattern}"))


def newest(takes):
    """The newest manifest."""
    return files(takes, MANIFEST)[-1]


def label(takes):
    """The label of the first segment of the newest snapshot."""
    return takes.place.folder / json.loads(newest(takes).read_text())["segments"][0]["label"]


def fill(takes, count=7):
    for number in range(count):
        takes.publish(f"take{number}", 32 + 17 * number)  # some whole numbers of blocks


def aged(takes):
    """Let the folders of records be as old as those of an archive are that nobody writes to."""
    for path in takes.place.folder.glob("published/*"):
        os.utime(path, ns=(10**18, 10**18 + len(path.name)))
