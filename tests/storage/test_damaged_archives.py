"""Every file of a small archive harmed in every way, and every command run on it.

A command answers as it did before the harm, leaves out what is harmed and says so, or ends with 3
or 4 and a sentence. It never answers otherwise, and never with a traceback.
"""

import itertools
import json
import os
import shutil

import numpy as np
import pytest

from flows.command.main import BAD_INPUT, DONE, RUN_FAILED, WRONG_USE, main
from storage.index import snapshots
from tasks.retrieval.gathering import gather_segments
from tasks.retrieval.pruned.summaries import SUMMARIES
from tests.conftest import cases
from tests.figures.archives.imported import take_in_plainly

TAKES = ("okuri48", "okuri49", "radio")
HARMED = "okuri49"

COMMANDS = {
    "takes": ("takes", "A", "--json"),
    "show": ("show", "A", HARMED, "--json"),
    "path": ("path", "A", HARMED),
    "export": ("export", "A", HARMED, "out.csv"),
    "search": ("search", "A", "okuri48:20-50", "--json", "--top", "40"),
    "search with": ("search", "A", f"{HARMED}:20-50", "--json", "--top", "40"),
    "verify": ("verify", "A"),
    "gc": ("gc", "A", "--older-than", "0"),
}


def flip(path, rng):
    """Change a bit."""
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    path.write_bytes(content)


def cut(path, rng):
    """Cut the file off."""
    content = path.read_bytes()
    path.write_bytes(content[: rng.integers(len(content))])


def remove(path, _rng):
    """Take the file away."""
    path.unlink()


def blank(path, _rng):
    """Write zeros, as a copy that was broken off leaves them."""
    path.write_bytes(bytes(path.stat().st_size))


def folder(path, _rng):
    """Put a folder in its place."""
    path.unlink()
    path.mkdir()


def pipe(path, _rng):
    """Put a pipe in its place, which nobody writes to."""
    path.unlink()
    os.mkfifo(path)


def dangle(path, _rng):
    """Put a link to nothing in its place."""
    path.unlink()
    path.symlink_to("nothing")


def other(path, _rng):
    """Put the like file of another take in its place."""
    path.write_bytes(twin_of(path).read_bytes())


def linked(path, _rng):
    """Put a link to the like file of another take in its place."""
    twin = twin_of(path)
    path.unlink()
    path.symlink_to(twin)


HARMS = (flip, cut, remove, blank, folder, pipe, dangle, other, linked)


def twin_of(path):
    """The file of another take that is like this one."""
    root = next(parent for parent in path.parents if (parent / "archive.json").exists())
    place = path.relative_to(root).as_posix()
    like = place.replace(HARMED, "radio")
    found = [
        each for each in root.rglob("*")
        if each.is_file() and _without_version(each, root) == _without_version(root / like, root)
    ]  # fmt: skip
    return found[0] if found else root / "archive.json"


def _without_version(path, root):
    """The path of a file with the random part of a version left out, and every digest."""
    parts = path.relative_to(root).as_posix().split("/")
    return [part if len(part) < 15 else part[:7] + part[15:][-9:] for part in parts]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An archive of three takes, of equal length, that is not harmed; and what commands say."""
    from storage.formats.motion.trc import write_trc
    from storage.schema import JOINTS
    from tests.conftest import swaying_body

    top = tmp_path_factory.mktemp("whole")
    (top / "inbox").mkdir()
    for seed, name in enumerate(TAKES):
        write_trc(top / "inbox" / f"{name}.trc", swaying_body(seed, 80), JOINTS, 30.0)
        about = f'[take]\ntitle = "所作 {seed}"\nperformer = "TK"\n'
        (top / "inbox" / f"{name}.toml").write_text(about, encoding="utf-8")
    take_in_plainly(top / "archive", top / "inbox")
    return top / "archive"


def run(capsys, archive, command, out):
    """Run a command; return its exit code, what it answered, and its messages."""
    out.unlink(missing_ok=True)
    words = {"A": str(archive), "out.csv": str(out)}
    code = main([words.get(each, each) for each in COMMANDS[command]])
    said = capsys.readouterr()
    answer = out.read_text() if out.exists() else said.out
    return code, answer, said.err


def answer_of(command, text):
    """What an answer says, without how long it took and where the archive is."""
    if command == "path":
        return text.rsplit("/", 3)[1:]
    if not text.startswith("{"):
        return text
    answer = json.loads(text)
    answer.pop("seconds", None)
    answer.pop("path", None)
    return answer


def agrees(command, right, text):
    """Whether an answer is that of the whole archive, or that without what is said to be harmed."""
    found = answer_of(command, text)
    if found == right:
        return True
    if command == "takes":
        kept = [take for take in right["takes"] if take in found["takes"]]
        return found["takes"] == kept
    if not command.startswith("search"):
        return False
    skipped = {each["take"] for each in found["skipped"]}
    if found["searched"]["takes"] + len(skipped) < len(TAKES):
        skipped.add(HARMED)  # without a record it is no take, which `verify` tells
    takes = {each["take"] for each in right["matches"]} - skipped
    same = [
        [{**each, "rank": 0} for each in answer["matches"] if each["take"] in takes]
        for answer in (right, found)
    ]
    return same[0] == same[1]


def files_of(archive):
    """The files on which the commands stand: those of one take, and the archive's own."""
    found = [path.relative_to(archive) for path in sorted(archive.rglob("*")) if path.is_file()]
    return [path for path in found if HARMED in path.as_posix() or len(path.parts) < 3]


def pytest_id(case):
    """A name for a case."""
    return case.__name__


@pytest.mark.drawn
@pytest.mark.slow
@pytest.mark.parametrize("harm", HARMS, ids=pytest_id)
def test_no_command_answers_from_a_harmed_archive(whole, tmp_path, capsys, harm):
    rng = np.random.default_rng(HARMS.index(harm))
    right = {
        name: answer_of(name, run(capsys, whole, name, tmp_path / "out.csv")[1])
        for name in COMMANDS
        if name not in ("verify", "gc")
    }
    chances = list(itertools.product(files_of(whole), COMMANDS))
    chosen = rng.permutation(len(chances))[: cases(24)]
    refused = 0
    for number in chosen:
        file, command = chances[number]
        archive = tmp_path / "archive"
        shutil.rmtree(archive, ignore_errors=True)
        shutil.copytree(whole, archive)
        before = (archive / file).read_bytes()
        harm(archive / file, rng)
        code, answer, err = run(capsys, archive, command, tmp_path / "out.csv")
        case = f"{harm.__name__} {file}: {command}: {code}\n{answer}\n{err}"
        assert code in (DONE, WRONG_USE, BAD_INPUT, RUN_FAILED), case
        assert "Traceback" not in err, case
        assert "fault of the program" not in err, case
        assert code == DONE or err.strip() or (command == "verify" and answer), case
        if command == "verify":
            assert code == BAD_INPUT or not is_seen(archive / file, before), case
        elif command == "gc":
            kept = [path for path in (archive / "takes").glob("*/*") if path.is_dir()]
            assert len(kept) == len(TAKES), case
        elif code == DONE or answer:
            assert agrees(command, right[command], answer), case
        refused += code != DONE
    assert 0 < refused < len(chosen)


@pytest.mark.slow
@pytest.mark.parametrize(
    "harm",
    [flip, *(pytest.param(harm, marks=pytest.mark.long) for harm in (remove, pipe))],
    ids=pytest_id,
)
def test_no_command_answers_from_a_harmed_index(whole, tmp_path, capsys, harm):
    rng = np.random.default_rng(HARMS.index(harm))
    gathered, archive = tmp_path / "gathered", tmp_path / "archive"
    shutil.copytree(whole, gathered)
    assert gather_segments(str(gathered)) == []
    commands = ("takes", "search", "search with", "verify")
    right = {
        name: answer_of(name, run(capsys, whole, name, tmp_path / "out.csv")[1])
        for name in commands
    }
    for name in ("takes", "search"):
        assert answer_of(name, run(capsys, gathered, name, tmp_path / "out.csv")[1]) == right[name]
    files = [path.relative_to(gathered) for path in gathered.glob("index/*/*")]
    summaries = {file for file in files if file.name.split(".")[1] in SUMMARIES}
    assert (len(files), len(summaries)) == (3 + len(SUMMARIES), len(SUMMARIES))
    kept = sorted(summaries)[:1]  # they are all alike
    for file, command in itertools.product({*files} - summaries | {*kept}, commands):
        shutil.rmtree(archive, ignore_errors=True)
        shutil.copytree(gathered, archive)
        harm(archive / file, rng)
        snapshots._held.clear()  # as a new process
        code, answer, err = run(capsys, archive, command, tmp_path / "out.csv")
        case = f"{harm.__name__} {file}: {command}: {code}\n{answer}\n{err}"
        assert "Traceback" not in err, case
        assert "fault of the program" not in err, case
        if command == "verify":
            assert code == BAD_INPUT, case
            assert "run `shosa index`" in answer, case
        elif command == "takes":
            assert code == DONE, case
            assert answer_of(command, answer) == right[command], case
        elif file in summaries:  # so little is scanned, and what no search reads harms none
            assert code == DONE, case
            assert agrees(command, right[command], answer), case
        else:
            assert code in (DONE, BAD_INPUT), case
            assert "run `shosa index`" in err, case
            assert not answer or agrees(command, right[command], answer), case


def is_seen(path, before):
    """Whether `verify` has to see what a file has become: what is relied on says something else."""
    if path.name == "archive.json" or path.parent.name == "sources":
        return False  # who made it, and what was ingested from where, are not relied on
    if not path.is_file():
        return path.parent.parent.name != "sources"  # archives of before have no copies
    after = path.read_bytes()
    if path.suffix == ".json" and path.name != "zarr.json":
        try:
            return json.loads(after) != json.loads(before)
        except ValueError:
            return True
    return after != before
