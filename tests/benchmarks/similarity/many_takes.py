"""Measure an archive of many takes: opening, listing, searching, one take more, verifying.

    python -m tests.benchmarks.similarity.many_takes [--takes 100000] [--keep DIR] [--s3]

The takes are short (60 to 300 frames) and drawn from a few generated dances. Records and search
arrays are written as ingesting writes them; their motion is not, for nothing here reads it.
With `--s3` the archive is in an object store on loopback that answers each request 20 ms late.
"""

import argparse
import asyncio
import os
import resource
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from storage import create_archive, open_archive
from storage.arrays.search import write_search_array
from storage.index import catalogue, snapshots
from storage.index.entries import entry_of
from storage.index.segments import new_rows, rewrite_label, write_segment
from storage.index.snapshots import open_snapshot, publish_snapshot, verify_snapshot
from storage.places import Place, create_file, write_file
from storage.records import Record, record_content, record_path
from storage.schema import JOINTS
from tasks.motion.stature import measure_stature
from tasks.retrieval.answering import answer_query
from tasks.retrieval.gathering import gather_when_many
from tasks.retrieval.normalization import INDEX_RATE_HZ, ROWS, pack_motion
from tasks.retrieval.opening import SUMMARIZED, places, room
from tasks.retrieval.pruned.summaries import summarize_rows
from tasks.retrieval.searching import SearchSettings
from tasks.studio.dancing.choreography import freely, lonely, okuri48, walk
from tasks.studio.performances import SH, TK, YS, generate_performance

FRAMES = (60, 300)
"""How long a take is [frames]."""
FULL = 1_000_000
"""How many samples a segment has when it is full [samples]."""
LATENCY_S = 0.02
"""How late the object store answers a request [s]."""
MORE = 300
"""How many takes are added one after another [takes]: one merge among them."""


def main() -> None:
    """Make the archive where it is not there yet, and print what it costs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--takes", type=int, default=100_000)
    parser.add_argument("--keep", type=Path, help="make the archive here, and use it again")
    parser.add_argument("--s3", action="store_true", help="in an object store with latency")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.s3:
            os.environ["XDG_CACHE_HOME"] = folder
            with slow_object_store() as location:
                measure(location, options.takes)
        else:
            measure(str(options.keep or Path(folder, "archive")), options.takes)


def measure(location: str, wanted: int) -> None:
    """Fill the archive up to so many takes, and measure it."""
    place = create_archive(location).place
    dances = generated()
    made = len(open_archive(location).listing().entries)
    begin = time.perf_counter()
    if made < wanted:
        fill(place, made, wanted, dances)
    say(f"{wanted:,} takes ({time.perf_counter() - begin:.0f} s to make {max(0, wanted - made):,})")
    if place.folder:
        say(f"on disk: {size_of(place.folder / 'index'):.1f} MB in index/")
    snapshot = tell("opening the index", lambda: open_anew(place))
    frames = sum(int(label.samples.sum()) for label in snapshot.labels)
    files = len(snapshot.labels)
    say(f"  {files} segments, {frames:,} samples, {max_memory():.0f} MB of memory so far")
    listing = tell("listing, labels read before", open_archive(location).listing)
    say(f"  {len(listing.entries):,} takes, {max_memory():.0f} MB of memory so far")
    take = listing.entries[len(listing.entries) // 2]
    command = [sys.executable, "-m", "flows.command.main"]
    for words in (["takes", location], ["search", location, f"{take.take}:5-50", "--takes", "x*"]):
        run = partial(subprocess.run, [*command, *words], capture_output=True, check=False)
        tell(f"shosa {words[0]}, process and all", run)
    settings = SearchSettings(part="feet")
    pattern = f"{take.take[:-2]}*"
    tell(
        f"searching feet in {pattern}",
        lambda: answer_query(location, f"{take.take}:5-50", settings, pattern),
    )
    answer = tell(
        "searching feet in all takes", lambda: answer_query(location, f"{take.take}:5-50", settings)
    )
    say(f"  {answer.searched_takes:,} takes, {answer.searched_frames:,} frames")
    say(f"  {max_memory():.0f} MB of memory at most, mapped pages that were read included")
    published, looked, worked = [], [], []
    for number in range(MORE):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        add(place, len(listing.entries) + number, dances)
        published.append(time.perf_counter() - begin)
        gather_when_many(location)
        looked.append(time.perf_counter() - begin - published[-1])
        worked.append(time.process_time() - begin_cpu)
    say(
        f"adding {MORE} takes one by one: {1e3 * np.median(published):.1f} ms a take to publish it "
        f"(median), {1e3 * np.median(looked):.1f} ms to see whether many have gathered, "
        f"{1e3 * np.mean(looked):.1f} ms with the merge ({max(looked):.2f} s) among them; "
        f"{1e3 * np.mean(worked):.1f} ms of processor time in all"
    )
    faults, held = tell("verifying the index", lambda: verify_snapshot(place))
    say(f"  {len(held):,} takes, {len(faults)} faults")


def generated() -> list[np.ndarray]:
    """Return the packed rows of a few dances."""
    found = []
    for number, performer in enumerate((TK, SH, YS)):
        movements = [okuri48(), walk(6), lonely(), freely(number, 30.0)]
        performance = generate_performance(movements, performer, day=number, rate_hz=INDEX_RATE_HZ)
        stature_m = measure_stature(performance.position, JOINTS) or 1.6
        found.append(pack_motion(performance.position, INDEX_RATE_HZ, stature_m))
    return found


def fill(place: Place, made: int, wanted: int, dances: list[np.ndarray]) -> None:
    """Publish takes, whose rows are put into segments at once."""
    before = open_snapshot(place)
    labels = [*zip(before.labels, before.digests, strict=True)]
    number = made
    while number < wanted:
        records, arrays = [], []
        while number < wanted and sum(room(rows.shape[1]) for rows in arrays) < FULL:
            record, rows = draw(number, dances)
            records.append(record)
            arrays.append(rows)
            write_plainly(place, record_path(record.take, 1), record_content(record))
            number += 1
        counts = [rows.shape[1] for rows in arrays]
        first, total = places(counts)
        content = new_rows(ROWS, total)
        for rows, begin in zip(arrays, first, strict=True):
            content[1][:, begin : begin + rows.shape[1]] = rows
        entries = [entry_of(record) for record in records]
        spans = [*zip(first, counts, strict=True)]
        nothing = [None] * len(records)
        summaries = summarize_rows(content[1])
        labels.append(
            write_segment(place, entries, nothing, spans, content, summaries, summarized=SUMMARIZED)
        )
    stamps, _ = catalogue._stamps(place)  # known without reading what was just written
    stamped = [
        rewrite_label(place, each, each.entries, [stamps[e.take] for e in each.entries])
        for each, _ in labels
    ]
    publish_snapshot(place, before.newest + 1, stamped, left=(0, 0))


def write_plainly(place: Place, path: str, content: bytes) -> None:
    """Write a file, on a disk without waiting for the medium."""
    if place.folder:
        (place.folder / path).parent.mkdir(parents=True, exist_ok=True)
        (place.folder / path).write_bytes(content)
    else:
        write_file(place, path, content)


def add(place: Place, number: int, dances: list[np.ndarray]) -> None:
    """Publish a take: its search array and its record, as ingesting writes them."""
    record, rows = draw(number, dances)
    write_search_array(place, record.take, record.version, rows)
    create_file(place, record_path(record.take, 1), record_content(record))


def draw(number: int, dances: list[np.ndarray]) -> tuple[Record, np.ndarray]:
    """Return the record and the packed rows of a take."""
    rng = np.random.default_rng(number)
    rows = dances[number % len(dances)]
    frames = int(rng.integers(*FRAMES))
    first = int(rng.integers(rows.shape[1] - frames))
    rows = rows[:, first : first + frames] * np.float32(rng.uniform(0.9, 1.1))
    take, version = f"take-{number:06d}", f"000001-{number:08x}"
    record = Record(
        take=take,
        version=version,
        number=1,
        source={
            "kind": "bvh", "name": f"{take}.bvh", "path": f"/inbox/{take}.bvh",
            "digest": f"{number:064x}", "code": "c" * 64,
        },
        metadata={"title": f"Dance {number}", "performer": "TK", "recorded": "2026-03-02"},
        frames=frames,
        rate_hz=INDEX_RATE_HZ,
        joints_present=list(JOINTS),
        stages=["motion"],
        files={
            f"motion/{name}": {"bytes": 1000, "sha256": f"{number:064x}"}
            for name in ("zarr.json", "position/c/0/0/0", "filled/c/0/0", "time/c/0", "joint/c/0")
        },
        notes=["The unit is taken for mm.", "Gaps of up to 5 frames were filled."],
    )  # fmt: skip
    return record, rows


def open_anew(place: Place) -> Any:
    """Open the index as a new process does."""
    snapshots._held.clear()
    return open_snapshot(place)


def tell(what: str, do: Callable[[], Any]) -> Any:
    """Do something, and print how long it took."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    done = do()
    cpu = time.process_time() - begin_cpu
    say(f"{what}: {time.perf_counter() - begin:.2f} s ({cpu:.2f} s of processor time here)")
    return done


def max_memory() -> float:
    """Return the most memory that this process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def size_of(folder: Path) -> float:
    """Return how large the files below a folder are [MB]."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6


@contextmanager
def slow_object_store() -> Iterator[str]:
    """Give the URL of an empty archive in an object store that answers late."""
    import boto3

    near, far = free_port(), free_port()
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(near)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    threading.Thread(target=lambda: asyncio.run(delay(far, near)), daemon=True).start()
    os.environ |= {
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_REGION": "us-east-1",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{far}",
        "AWS_ALLOW_HTTP": "true",
    }
    try:
        while True:
            try:
                socket.create_connection(("127.0.0.1", near), timeout=1).close()
                socket.create_connection(("127.0.0.1", far), timeout=1).close()
                break
            except OSError:
                time.sleep(0.2)
        boto3.client("s3").create_bucket(Bucket="shosa-many")
        yield "s3://shosa-many/archive"
    finally:
        server.kill()
        server.wait()


async def delay(port: int, to: int) -> None:
    """Pass connections on to another port, what is asked on each `LATENCY_S` late."""

    async def pump(reader: Any, writer: Any, late_s: float) -> None:
        while data := await reader.read(1 << 18):
            await asyncio.sleep(late_s)
            writer.write(data)
            await writer.drain()
        writer.close()

    async def serve(reader: Any, writer: Any) -> None:
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", to)
        await asyncio.gather(
            pump(reader, inner_writer, LATENCY_S),
            pump(inner_reader, writer, 0.0),
            return_exceptions=True,
        )

    async with await asyncio.start_server(serve, "127.0.0.1", port) as server:
        await server.serve_forever()


def free_port() -> int:
    """Return a port of this machine that nobody listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def say(text: str) -> None:
    """Print to standard output at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
