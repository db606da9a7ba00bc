"""The command `shosa`: one sub-command a flow, or a look into an archive.

Data goes to standard output, messages to standard error. Exit codes: 0 done, 2 wrong use,
3 bad input, 4 a run failed, 130 interrupted. Prefect, Zarr and xarray are imported by the
sub-commands that need them; a search does not.
"""

import argparse
import gc
import io
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flows.clusters import THREADS
from flows.command import printing
from flows.command.exits import BAD_INPUT, DONE, INTERRUPTED, RUN_FAILED, WRONG_USE
from flows.command.options import (
    UsageError,
    add_import_options,
    add_search_options,
    check_before_flow,
    check_environment,
    clip_of,
    digitization_settings,
    import_settings,
    query_settings,
    search_settings,
    values_refused,
)
from flows.command.preparing import (
    compiling_early,
    hush_prefect,
    loading_early,
    prepare_prefect,
)
from flows.command.serving import add_serve_options, run_serve
from flows.command.terminal import bars, log_to_standard_error, search_bar
from flows.command.upkeep import add_upkeep
from flows.command.viewing import add_report, add_view
from flows.command.views import add_render_options, export_voxels_or_segment, plan, render
from storage import create_archive, open_archive
from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.provenance import shosa_version
from storage.recordings import find_recordings

logger = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sub-command in `arguments` (default: the command line); return the exit code."""
    _write_any_text()
    options = build_parser().parse_args(arguments)
    log_to_standard_error(quiet=options.quiet, verbose=options.verbose)
    try:
        return options.run(options)
    except (UnknownNameError, UsageError) as error:
        return _fail(error, WRONG_USE)
    except (InputError, ArchiveError) as error:
        return _fail(error, BAD_INPUT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        return _fail(error, RUN_FAILED)
    except KeyboardInterrupt:
        return _fail(
            "interrupted; what was published stays, the rest can be run again", INTERRUPTED
        )
    except Exception as error:
        logger.debug("the fault in full", exc_info=error)
        said = " ".join(f"{type(error).__name__}: {error}".split())
        return _fail(
            f"this is a fault of the program ({said}); run it with --verbose and report what it "
            "says",
            RUN_FAILED,
        )


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="shosa", description="Digital archives of dance: ingest motion, search by movement."
    )
    parser.add_argument("--version", action="version", version=f"shosa {shosa_version()}")
    loudness = parser.add_mutually_exclusive_group()
    loudness.add_argument("--quiet", action="store_true", help="only errors on standard error")
    loudness.add_argument(
        "-v", "--verbose", action="store_true", help="a line a stage and take, and how long it took"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_demo(commands)
    _add_ingest(commands)
    _add_serve(commands)
    _add_looks(commands)
    _add_search(commands)
    _add_export(commands)
    add_view(commands, _command)
    add_report(commands, _command)
    add_upkeep(commands, _command)
    return parser


def _command(commands: Any, name: str, run: Any, text: str) -> argparse.ArgumentParser:
    """Add a sub-command that calls `run` with the parsed options."""
    command = commands.add_parser(name, help=text, description=text)
    command.set_defaults(run=run)
    return command


def _add_demo(commands: Any) -> None:
    text = "make an archive from generated performances, search it, draw what was found"
    demo = _command(commands, "demo", _demo, text)
    demo.add_argument("folder", nargs="?", default="shosa-demo", metavar="DIR")


def _add_ingest(commands: Any) -> None:
    text = "take captures and motion files (C3D, TRC, BVH) into an archive, by the Prefect flows"
    ingest = _command(commands, "ingest", _ingest, text)
    ingest.add_argument("archive", metavar="ARCHIVE", help="a directory or s3://bucket/prefix")
    ingest.add_argument("paths", nargs="+", metavar="PATH", help="a capture, a file, a folder")
    ingest.add_argument("--json", action="store_true", help="print the outcome as JSON")
    add_import_options(ingest)
    ingest.add_argument("--low-pass", type=float, metavar="HZ", help="smooth the markers")
    ingest.add_argument(
        "--settings",
        metavar="FILE.toml",
        help="how captures are digitized, before their own digitize.toml; see `shosa settings`",
    )
    ingest.add_argument(
        "--again", action="store_true", help="take in anew what the archive has already"
    )
    _add_runner(ingest)
    settings = _command(
        commands, "settings", _settings, "print every setting of every stage as TOML to be edited"
    )
    settings.add_argument("--json", action="store_true")


def _add_runner(command: Any) -> None:
    command.add_argument(
        "--runner",
        default=THREADS,
        metavar="NAME",
        help="what computes: threads (default), dask, or dask://HOST:PORT of a scheduler",
    )


def _add_serve(commands: Any) -> None:
    text = "take in what is dropped into inboxes, and show the runs on a dashboard, until a signal"
    add_serve_options(_command(commands, "serve", _serve, text))


def _add_looks(commands: Any) -> None:
    takes = _command(commands, "takes", _takes, "list the takes of an archive")
    takes.add_argument("archive", metavar="ARCHIVE")
    takes.add_argument("--json", action="store_true")
    show = _command(commands, "show", _show, "describe one take")
    show.add_argument("archive", metavar="ARCHIVE")
    show.add_argument("take", metavar="TAKE")
    show.add_argument("--json", action="store_true")
    path = _command(commands, "path", _path, "print where a take's Zarr group is")
    path.add_argument("archive", metavar="ARCHIVE")
    path.add_argument("take", metavar="TAKE")


def _add_search(commands: Any) -> None:
    search = _command(commands, "search", _search, "find what moves like a clip")
    search.add_argument("archive", metavar="ARCHIVE")
    search.add_argument(
        "query", metavar="QUERY", help="TAKE[:START-END] or FILE[:START-END], frames inclusive"
    )
    add_search_options(search)
    search.add_argument("--steps", choices=("slope", "paper"), default="slope")
    search.add_argument("--json", action="store_true")
    where = search.add_mutually_exclusive_group()
    where.add_argument("--flow", action="store_true", help="run it as a Prefect flow")
    _add_runner(where)


def _add_export(commands: Any) -> None:
    text = (
        "write joints (TRC, C3D, BVH, CSV, GLB), voxels (PLY, GLB) or the initial model (JSON) of "
        "a take, by the suffix of FILE"
    )
    export = _command(commands, "export", _export, text)
    export.add_argument("archive", metavar="ARCHIVE")
    export.add_argument("take", metavar="TAKE")
    export.add_argument("file", metavar="FILE")
    export.add_argument("--frames", metavar="START-END", help="only these frames, inclusive")
    export.add_argument("--mesh", action="store_true", help="PLY: a closed surface, not points")
    export.add_argument("--voxels", action="store_true", help="GLB: voxels, not the skeleton")
    export.add_argument("--segment", metavar="NAME", help="one segment: voxels (PLY), motion (CSV)")
    text = "write a view of a take's voxels from where no camera stood: a still or a film"
    add_render_options(_command(commands, "render", _render, text))
    text = "say what a layout of cameras would see, before they are hung"
    plan_layout = _command(commands, "plan", _plan, text)
    plan_layout.add_argument(
        "cameras", metavar="CAMERAS.toml", help="positions by hand, or any calibration"
    )
    plan_layout.add_argument("--json", action="store_true")


def _demo(options: argparse.Namespace) -> int:
    prepare_prefect()
    from flows.command.demo import run_demo

    return DONE if run_demo(Path(options.folder), quiet=options.quiet) else RUN_FAILED


def _ingest(options: argparse.Namespace) -> int:
    # all of it before Prefect starts, which takes long
    importing = import_settings(options, low_pass_hz=options.low_pass)
    settings = digitization_settings(options.settings)
    check_environment()
    recordings = find_recordings(options.paths)
    create_archive(options.archive)
    # what digitizes here; else workers compile and load what they need
    here = options.runner == THREADS and any(each.is_dir() for each in recordings)
    with bars(quiet=options.quiet), compiling_early(wanted=here):
        outcomes = _run_ingestion(options, importing, settings, digitizes=here)
    printing.print_outcomes(outcomes, as_json=options.json)
    failed = {outcome.status for outcome in outcomes}
    if "failed" in failed:
        return RUN_FAILED
    return BAD_INPUT if "refused" in failed else DONE


def _run_ingestion(
    options: argparse.Namespace, importing: Any, settings: Any, *, digitizes: bool
) -> list[Any]:
    """Start Prefect, and take the recordings in; return what became of each."""
    prepare_prefect()
    from flows.ingestion import run_ingestion
    from flows.runners import task_runner

    with values_refused():
        runner = task_runner(options.runner)
    given = (options.archive, options.paths, importing, settings)
    with loading_early(wanted=digitizes):
        return run_ingestion(*given, again=options.again, runner=runner)


def _serve(options: argparse.Namespace) -> int:
    hush_prefect()
    return run_serve(options)


def _settings(options: argparse.Namespace) -> int:
    from dataclasses import asdict

    from tasks.settings import all_settings, format_settings

    if options.json:
        printing.print_json({"settings": [asdict(each) for each in all_settings()]})
        return DONE
    for line in format_settings():
        printing.print_line(line)
    return DONE


def _takes(options: argparse.Namespace) -> int:
    gc.disable()  # it would walk 100,000 takes again and again, of which none becomes garbage
    try:
        listing = open_archive(options.archive).listing()
        printing.print_takes(listing.entries, as_json=options.json)
    finally:
        gc.enable()
    for fault in listing.faults.values():
        printing.say(fault)
    return BAD_INPUT if listing.faults else DONE


def _show(options: argparse.Namespace) -> int:
    take = open_archive(options.archive).take(options.take)
    printing.print_take(take, as_json=options.json)
    return DONE


def _path(options: argparse.Namespace) -> int:
    take = open_archive(options.archive).take(options.take)
    take.check_there()
    printing.print_line(take.path)
    return DONE


def _answer(options: argparse.Namespace, arguments: tuple[Any, ...]) -> Any:
    """Search as a flow, or here with a bar."""
    if options.flow:
        from flows.searching import search_archive

        return search_archive(*arguments)
    from flows.clusters import search_cluster
    from tasks.retrieval.answering import answer_query

    with (
        search_cluster(options.runner) as cluster,
        search_bar(quiet=options.quiet) as bar,
        printing.told_if_stopped(bar) as told,
    ):
        return answer_query(*arguments, tell=told, cluster=cluster)


def _search(options: argparse.Namespace) -> int:
    settings, imported = search_settings(options), query_settings(options)
    arguments = (options.archive, options.query, settings, options.takes, imported)
    if options.flow:
        check_before_flow(options)
        prepare_prefect()
    with values_refused():
        answer = _answer(options, arguments)
    printing.print_answer(answer, as_json=options.json)
    return DONE


def _export(options: argparse.Namespace) -> int:
    from tasks.exporting.joints import export_take

    clip = clip_of(options)
    with values_refused():
        notes = export_voxels_or_segment(options, clip)
    if notes is None:
        notes = export_take(options.archive, options.take, options.file, clip=clip)
    for note in notes:
        printing.say(note)
    return DONE


def _render(options: argparse.Namespace) -> int:
    clip = clip_of(options)
    with values_refused():
        render(options, clip)
    return DONE


def _plan(options: argparse.Namespace) -> int:
    plan(options)
    return DONE


def _write_any_text() -> None:
    """Let a terminal or pipe that lacks a letter show its number, in place of a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _fail(error: Exception | str, code: int) -> int:
    """Say what went wrong in one sentence, and return the exit code."""
    printing.say(f"shosa: {error}")
    return code


if __name__ == "__main__":
    sys.exit(main())
