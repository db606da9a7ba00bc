"""The sub-commands that keep cameras, an archive and an installation in order."""

import argparse
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flows.command import printing
from flows.command.calibrating import add_calibrate_options, calibrate
from flows.command.exits import BAD_INPUT, DONE, RUN_FAILED
from flows.command.options import UsageError, check_hours
from flows.command.preparing import prepare_prefect
from flows.command.terminal import bars, work_bar
from storage import open_archive
from storage.formats.settings_toml import SETTINGS_FILE, read_capture_settings

if TYPE_CHECKING:
    from tasks.checks.agreement import AgreementSettings
    from tasks.reconstruction.silhouettes import SilhouetteSettings


def add_upkeep(commands: Any, make: Any) -> None:
    """Add the sub-commands; `make` adds one."""
    index = make(commands, "index", _index, "build the search arrays of all takes anew")
    index.add_argument("archive", metavar="ARCHIVE")
    verify = make(commands, "verify", _verify, "recompute every digest")
    verify.add_argument("archive", metavar="ARCHIVE")
    collect = make(commands, "gc", _collect_garbage, "remove what nothing refers to")
    collect.add_argument("archive", metavar="ARCHIVE")
    collect.add_argument(
        "--older-than",
        type=float,
        default=24.0,
        metavar="HOURS",
        help="leave alone what somebody may still write or read (default 24)",
    )
    collect.add_argument(
        "--lost", action="store_true", help="also what was published and has lost its record"
    )
    text = "calibrate cameras from films or pictures of a board; writes calibration.toml"
    add_calibrate_options(make(commands, "calibrate", _calibrate, text))
    doctor = make(commands, "doctor", _doctor, "say what is wrong with an installation")
    doctor.add_argument("captures", nargs="*", metavar="CAPTURE", help="examine these instead")
    doctor.add_argument("--out", metavar="DIR", help="for pictures (default: CAPTURE-doctor)")
    doctor.add_argument(
        "--refine", action="store_true",
        help="where the silhouettes have the cameras: a calibration beside the pictures",
    )  # fmt: skip


def _index(options: argparse.Namespace) -> int:
    open_archive(options.archive)  # before Prefect starts, which takes long
    prepare_prefect()
    from flows.indexing import run_indexing

    with bars(quiet=options.quiet):
        faults = run_indexing(options.archive)
    for fault in faults:
        printing.say(fault)
    return RUN_FAILED if faults else DONE


def _verify(options: argparse.Namespace) -> int:
    from tasks.checks.upkeep import verify_archive

    takes, faults, notes = verify_archive(options.archive)
    for fault in faults:
        printing.print_line(fault)
    for note in notes:
        printing.say(note)
    printing.say(f"{takes} takes verified, {len(faults)} faults")
    return BAD_INPUT if faults else DONE


def _collect_garbage(options: argparse.Namespace) -> int:
    from storage.upkeep.garbage import collect_garbage, kept_from_garbage

    check_hours(options.older_than)
    place = open_archive(options.archive).place
    older_than = timedelta(hours=options.older_than)
    removed = collect_garbage(place, older_than=older_than, lost=options.lost)
    for file in removed:
        printing.print_line(file.path)
    for note in kept_from_garbage(place, lost=options.lost):
        printing.say(note)
    size = sum(file.size for file in removed)
    printing.say(f"removed {len(removed)} files, {size / 1e6:.1f} MB")
    return DONE


def _calibrate(options: argparse.Namespace) -> int:
    return DONE if calibrate(options) else BAD_INPUT


def _capture_settings(folder: Path) -> "tuple[SilhouetteSettings, AgreementSettings]":
    """Return how silhouettes are found in a capture and compared, by its `digitize.toml`."""
    from tasks.settings import read_settings

    chosen = read_settings(read_capture_settings(folder), f"{folder}/{SETTINGS_FILE}")
    return chosen.silhouettes, chosen.agreement


def _doctor(options: argparse.Namespace) -> int:
    if options.out is not None and not options.captures:
        raise UsageError("--out is for pictures of captures; name a capture, or leave it out")
    if options.refine and not options.captures:
        raise UsageError("--refine is for the cameras of a capture; name one, or leave it out")
    if options.captures:
        from tasks.checks.examination import examine_captures

        into = Path(options.out) if options.out else None
        good = examine_captures(
            options.captures, into, printing.print_line, printing.say, _capture_settings,
            watch=lambda name: work_bar(name, quiet=options.quiet), refine=options.refine,
        )  # fmt: skip
        return DONE if good else BAD_INPUT
    from flows.command.doctor import examine_installation

    findings = examine_installation()
    for finding in findings:
        printing.print_line(f"{'ok  ' if finding.good else 'BAD '} {finding.text}")
    return DONE if all(finding.good for finding in findings) else RUN_FAILED
