"""Look after an archive: whether everything is still as it was published."""

from collections.abc import Iterator

from storage import Archive, Take, open_archive
from storage.arrays.search import verify_search_array
from storage.errors import ArchiveError
from storage.index.snapshots import verify_snapshot
from storage.publication import version_folder
from storage.schema import JOINTS
from storage.upkeep.garbage import unpublished_versions
from storage.upkeep.verification import verify_records, verify_take
from tasks.motion.stature import joints_present


def verify_archive(location: str) -> tuple[int, list[str], list[str]]:
    """Compare all that commands rely on with what was published.

    Returns
    -------
    takes
        How many there are.
    faults
        A sentence each.
    notes
        What is no fault, and a person may wonder about.
    """
    archive = open_archive(location)
    takes = archive.takes()
    faults = verify_records(archive.place)
    of_index, held = verify_snapshot(archive.place)
    faults += of_index
    for name in takes:
        found = verify_take(archive.place, name)
        faults += found or _faults_of(archive, name, held)
    notes = [
        f"{version_folder(take, version)} was never published: a run writes it, or was killed; "
        "`shosa gc` removes it when it is old"
        for take, version in unpublished_versions(archive.place)
    ]
    return len(takes), faults, notes


def _faults_of(archive: Archive, name: str, held: set[tuple[str, str]]) -> Iterator[str]:
    """Yield where record, arrays and search array of a take that is whole disagree."""
    take = archive.take(name)
    if "motion" in take.record.stages and (name, take.record.version) not in held:
        yield from verify_search_array(archive.place, name, take.record.version)
    try:
        yield from (f"take {name!r}: its record {said}" for said in _disagreements(take))
    except (ArchiveError, KeyError, TypeError, ValueError) as error:
        yield f"take {name!r} cannot be read, though its files are as published: {error}"


def _disagreements(take: Take) -> Iterator[str]:
    """Yield what the record of a take says that its arrays do not."""
    record = take.record
    if "motion" in record.stages:
        position = take.motion["position"].values
        there = joints_present(position)
        present = [joint for joint, is_there in zip(JOINTS, there, strict=True) if is_there]
        if len(position) != record.frames:
            yield f"says {record.frames} frames, and its motion has {len(position)}"
        if float(take.motion.attrs["rate_hz"]) != record.rate_hz:
            yield f"says {record.rate_hz:g} Hz, and its motion {take.motion.attrs['rate_hz']:g} Hz"
        if present != record.joints_present:
            yield f"says that {len(record.joints_present)} joints are there, and {len(present)} are"
    for name in {"pose", "silhouettes"} & {*record.stages}:
        frames = getattr(take, name).sizes["time"]
        if frames != record.frames:
            yield f"says {record.frames} frames, and its {name} have {frames}"
