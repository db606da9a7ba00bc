"""Measure a search from the shell, imports and all, over an archive of a million samples.

    python -m tests.benchmarks.running.archive [--samples 1000000] [--keep DIR]

The archive is generated: takes of a minute by three performers, at the index rate.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from storage import Archive, create_archive
from storage.arrays.groups import write_motion
from storage.provenance import recorded
from storage.publication import describe_files, new_version, publish_record, version_folder
from storage.records import Record
from storage.schema import JOINTS
from tasks.motion.stature import measure_stature
from tasks.retrieval.indexing import index_take
from tasks.retrieval.normalization import INDEX_RATE_HZ
from tasks.studio.dancing.choreography import freely, lonely, okuri48, walk
from tasks.studio.performances import SH, TK, YS, generate_performance

QUERY = "take-00007:300-469"
RUNS = 5
SECONDS_A_TAKE = 60
TARGET_S = 3.0


def main() -> None:
    """Make the archive where it is not there yet, search it, and print how long that takes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--keep", type=Path, help="make the archive here, and use it again")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        location = options.keep or Path(folder, "archive")
        begin = time.perf_counter()
        archive = create_archive(location)
        while (made := sum(record.frames for record in archive.records())) < options.samples:
            fill(archive, made, options.samples)
        say(f"{made:,} samples in {len(archive.takes())} takes ({elapsed(begin):.0f} s to make)")
        command = [sys.executable, "-m", "flows.command.main", "search", str(location), QUERY]
        seconds = []
        for _ in range(RUNS):
            begin = time.perf_counter()
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            seconds.append(elapsed(begin))
        say(done.stdout + done.stderr)
        say(
            f"search from the shell: first {seconds[0]:.2f} s, then {min(seconds):.2f} to "
            f"{max(seconds[1:]):.2f} s (target <= {TARGET_S:g} s)"
        )


def fill(archive: Archive, made: int, wanted: int) -> None:
    """Publish takes until the archive has the samples that are wanted."""
    number = len(archive.takes())
    while made < wanted:
        performer = (TK, SH, YS)[number % 3]
        movements = [okuri48(), walk(6), lonely()]
        movements += [freely(10 * number + i, 6.0) for i in range(SECONDS_A_TAKE // 8)]
        performance = generate_performance(movements, performer, day=number, rate_hz=INDEX_RATE_HZ)
        made += publish(archive, f"take-{number:05d}", performer.name, performance.position)
        number += 1


def publish(archive: Archive, take: str, performer: str, position) -> int:
    """Write, index and publish one take; return how many frames it has."""
    place = archive.place
    version = new_version(place, take)
    with recorded("benchmark", settings={}, inputs={}) as provenance:
        position = position.astype("float32")
    write_motion(
        place,
        version_folder(take, version),
        position=position,
        filled=position[..., 0] != position[..., 0],
        rate_hz=INDEX_RATE_HZ,
        attributes={"stature_m": measure_stature(position, JOINTS)},
        provenance=provenance,
    )
    index_take(str(place.location), take, version)
    record = Record(
        take=take,
        version=version,
        number=1,
        source={"kind": "bvh", "name": take, "path": take, "digest": take},
        metadata={"performer": performer},
        frames=len(position),
        rate_hz=INDEX_RATE_HZ,
        joints_present=list(JOINTS),
        stages=["motion"],
        files=describe_files(place, take, version),
    )
    publish_record(place, record)
    return len(position)


def elapsed(begin: float) -> float:
    """Return the seconds since `begin`."""
    return time.perf_counter() - begin


def say(text: str) -> None:
    """Print to standard output at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
