"""README and docs name what is there: links, files, commands, options, settings, references."""

import argparse
import ast
import importlib
import json
import re
import runpy
import shlex
import tomllib
from pathlib import Path

import pytest

from flows.command.main import build_parser
from tests.documents import (
    COMMAND,
    CONSTANTS,
    constants_of,
    find_constants,
    find_settings,
    settings_of,
    write_constants,
)

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
WRITTEN = [page for page in PAGES if page != CONSTANTS]
CONTRACT = ROOT / "docs" / "contract.md"

[_SUBPARSERS] = (a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
COMMANDS = {
    name: {option for action in parser._actions for option in action.option_strings}
    for name, parser in _SUBPARSERS.choices.items()
}

each_page = pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.name)


def blocks(page, language):
    """The blocks of code of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text("utf-8"), re.S | re.M)


def prose(page):
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.S | re.M)


def rows(page, head):
    """The rows, as lists of cells, of the tables of a page whose first head is this."""
    found, inside = [], False
    for line in prose(page).splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if not cells:
            inside = False
        elif inside and set(cells) != {"---"}:
            found.append(cells)
        elif cells[0] == head:
            inside = True
    return found


def quoted(text):
    """What stands in backquotes."""
    return re.findall(r"`([^`]+)`", text)


def commands_in(cell):
    """The names of the commands that the first cell of a row names."""
    return [text.split()[0] for text in quoted(cell)]


def planned():
    """The commands that the contract promises for later."""
    return {name for row in rows(CONTRACT, "planned") for name in commands_in(row[0])}


def anchors(page):
    """The anchors of a page's headings."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@each_page
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)\s]+)\)", prose(page))
    for link in links:
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        # what is generated is written when the documents are
        assert target.exists() or target == CONSTANTS, f"{page.name} links to {link}"
        assert not anchor or anchor in anchors(target), f"{page.name} links to {link}"


def test_the_readme_leads_to_every_document():
    text = (ROOT / "README.md").read_text("utf-8")
    for page in [*(ROOT / "docs").iterdir(), CONSTANTS]:
        assert f"(docs/{page.name})" in text


@each_page
def test_files_and_folders_that_are_named_are_there(page):
    for name in quoted(prose(page)):
        if re.fullmatch(r"(tasks|flows|storage|tests|docs)/[\w./-]*", name):
            assert (ROOT / name).exists(), f"{page.name} names {name}"


@each_page
def test_commands_in_blocks_are_understood(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.M))
    for line in "".join(blocks(page, "sh")).splitlines():
        program, *arguments = shlex.split(line, comments=True) or [""]
        if program == "shosa":
            build_parser().parse_args(arguments)
        elif program == "make":
            assert set(arguments) <= targets, line


@each_page
def test_commands_in_tables_and_sentences_exist_with_their_options(page):
    for row in rows(page, "command"):
        names = commands_in(row[0])
        assert set(names) <= set(COMMANDS), row
        options = set(re.findall(r"--[a-z][a-z-]*", row[1]))
        assert options <= set.union(*(COMMANDS[name] for name in names)), row
    for text in quoted(prose(page)):
        if found := re.match(r"shosa ([a-z]+)", text):
            assert found[1] in COMMANDS or found[1] in planned(), f"{page.name}: {text}"
            options = set(re.findall(r"--[a-z][a-z-]*", text))
            assert options <= COMMANDS.get(found[1], options), f"{page.name}: {text}"


@pytest.mark.parametrize("page", [CONTRACT, ROOT / "docs" / "using.md"], ids=["contract", "using"])
def test_every_command_stands_in_the_tables(page):
    assert {name for row in rows(page, "command") for name in commands_in(row[0])} == set(COMMANDS)


def test_what_is_planned_is_not_there_yet():
    there = planned() & set(COMMANDS)
    assert not there, f"move {there} from what is planned to the commands of {CONTRACT}"


@each_page
def test_examples_can_be_read(page):
    for text in blocks(page, "toml"):
        assert tomllib.loads(text)
    for text in blocks(page, "json"):
        assert json.loads(text)
    for text in blocks(page, "python"):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module or "")
                assert all(hasattr(module, each.name) for each in node.names)


def test_files_of_settings_in_examples_set_something():
    from tasks.settings import Settings, read_settings

    stages = set(vars(Settings()))
    files = [tomllib.loads(text) for page in WRITTEN for text in blocks(page, "toml")]
    files = [tables for tables in files if stages & set(tables)]
    assert files
    for tables in files:
        assert read_settings(tables, "the example") != Settings()


def test_references_stand_where_the_page_says():
    found = rows(ROOT / "docs" / "references.md", "reference")
    assert len(found) > 30
    for reference, _, files in found:
        authors = re.findall(r"[A-Z]\w+", re.split(r"[\"*]|, \d{4}", reference)[0] or reference)
        authors = authors or re.findall(r"[A-Z]\w+", reference)
        for file in quoted(files):
            text = (ROOT / file).read_text("utf-8")
            assert any(author in text for author in authors), f"{file} does not name {authors}"


def test_who_is_cited_in_the_code_stands_in_the_references():
    page = (ROOT / "docs" / "references.md").read_text("utf-8")
    cited = set()
    for package in ("flows", "tasks", "storage"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = " ".join(path.read_text("utf-8").split())
            cited |= set(
                re.findall(r"\b([A-Z][a-zé]\w+)(?: et al\.?)?,? \(?((?:19|20)\d\d)\b", text)
            )
    assert ("Laurentini", "1994") in cited
    missing = {f"{name} {year}" for name, year in cited if name not in page or year not in page}
    assert not missing


MODULE = '''
REACH = 0.6
"""How far a hand may be [statures]. Of four takes. It has
two lines."""
_STEP = 1 << 3  # every so many pixels
# how many there are of
# what is looked at
MOST, _LEAST = 10, np.float32(-2.5)
SIDES = ((1, "Neck", 0.06), *(2, 3))
"""By number."""
BARE = math.radians(40.0) + REACH  # fmt: skip
NAMES = ("Neck", "Head")
NUMBERS = [len(name) for name in NAMES]
THREADS = os.cpu_count() or 1
ON = True
lower = 3
Kind = NDArray[np.float64]
'''


def test_constants_are_told_by_the_docstring_below_or_the_comment_beside_or_above():
    found = [(c.name, c.value, c.unit, c.meaning, c.source) for c in constants_of("a.py", MODULE)]
    looked_at = "How many there are of what is looked at."
    assert found == [
        ("REACH", "0.6", "statures", "How far a hand may be.", "Of four takes. It has two lines."),
        ("_STEP", "1 << 3", "", "Every so many pixels.", ""),
        ("MOST", "10", "", looked_at, ""),
        ("_LEAST", "np.float32(-2.5)", "", looked_at, ""),
        ("SIDES", "((1, 'Neck', 0.06), *(2, 3))", "", "By number.", ""),
        ("BARE", "math.radians(40.0) + REACH", "", "", ""),
    ]


def test_settings_and_constants_are_written_as_the_code_has_them():
    assert CONSTANTS.exists(), f"run {COMMAND}"
    assert CONSTANTS.read_text("utf-8") == write_constants(), f"run {COMMAND}"


def test_every_setting_says_what_it_means():
    silent = [
        f"{kind.__module__}.{kind.__qualname__}: {each.name}"
        for kind in find_settings()
        for each in settings_of(kind)
        if not each.meaning
    ]
    assert not silent, "\n".join(silent)


def test_every_numeric_constant_says_what_it_means():
    silent = [f"{each.module}: {each.name}" for each in find_constants() if not each.meaning]
    assert not silent, "\n".join(silent)


@pytest.mark.slow
@pytest.mark.flow
@pytest.mark.compiled
@pytest.mark.usefixtures("prefect_server")
def test_the_tutorial_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(ROOT / "docs" / "tutorial.py"))
    said = capsys.readouterr().out
    assert said.count("ingested") == 5
    assert re.search(
        r"rank +take +start +end +distance +mirrored +level +chance +performer +title", said
    )
    for picture in ("right-foot.svg", "overlay.png", "filmed.png"):
        assert (tmp_path / "shosa-tutorial" / picture).stat().st_size > 5_000
