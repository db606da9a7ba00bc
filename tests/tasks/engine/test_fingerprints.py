"""Tests of tasks.engine.fingerprints."""

import dis
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

import pytest

from tasks.engine import fingerprints
from tasks.retrieval.indexing import index_take
from tests.conftest import ROOT


@dataclass(frozen=True)
class Settings:
    scale: float = 1.0


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path_factory):
    monkeypatch.setattr(fingerprints, "_KEPT", tmp_path_factory.mktemp("kept"))
    fingerprints._source_digest.cache_clear()
    fingerprints._look_into.cache_clear()
    yield
    fingerprints._source_digest.cache_clear()


def test_same_code_and_settings_give_the_same_name():
    first = fingerprints.fingerprint(index_take, {"settings": Settings(), "take": "okuri48"})
    again = fingerprints.fingerprint(index_take, {"take": "okuri48", "settings": Settings()})
    assert first == again


@pytest.mark.parametrize(
    "change", [{"take": "b"}, {"settings": Settings(2.0)}, {"path": Path("a")}]
)
def test_another_parameter_gives_another_name(change):
    base = {"take": "a", "settings": Settings(), "path": Path("b")}
    assert fingerprints.fingerprint(index_take, base) != fingerprints.fingerprint(
        index_take, {**base, **change}
    )


def test_two_functions_of_one_module_have_two_names():
    functions = (fingerprints.fingerprint, fingerprints.source_files)
    assert len({fingerprints.fingerprint(each, {}) for each in functions}) == 2


MODULE = """
'''A module.'''
from tasks.geometry import voxels

LIMIT_M = 0.5  # measured
'''How far.'''


class Settings:
    reach: float = 1.0
    '''A field.'''


def measure(a, b):
    '''Return a length.'''
    return f"{(a + b) * LIMIT_M:.2f} m", {"a": (1, 2)}
"""


@pytest.fixture
def named(tmp_path, monkeypatch):
    """A function that edits a module of ours and returns the new name of what stands on it."""

    def edit(module, change):
        path = Path(sys.modules[module].__file__)
        edited = tmp_path / "edited.py"
        edited.write_text(change(path.read_text()))
        with monkeypatch.context() as patched:
            patched.setattr(sys.modules[module], "__file__", str(edited))
            fingerprints._source_digest.cache_clear()
            found = fingerprints.fingerprint(index_take, {})
        fingerprints._source_digest.cache_clear()
        assert edited.read_text() != path.read_text()
        return found

    return edit


BEHIND = ["tasks.retrieval.indexing", "tasks.retrieval.normalization", "storage.schema"]
"""The module of a stage, one that it imports, and one that only other modules import."""


@pytest.mark.parametrize("module", BEHIND)
def test_an_edit_to_the_code_of_a_module_or_of_one_behind_it_gives_another_name(named, module):
    before = fingerprints.fingerprint(index_take, {})
    assert named(module, lambda text: text + "_NEW = 1\n") != before


@pytest.mark.parametrize("module", BEHIND)
@pytest.mark.parametrize(
    "change",
    [
        lambda text: text + "# a comment\n",
        lambda text: text.replace('"""', '"""Edited: ', 1),
        lambda text: "\n\n" + text,
    ],
    ids=["comment", "docstring", "empty lines"],
)
def test_an_edit_to_what_is_not_code_keeps_the_name(named, module, change):
    assert named(module, change) == fingerprints.fingerprint(index_take, {})


def digest(text):
    return fingerprints.code_digest(text.encode())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A module", "Another"),
        ("  # measured", ""),
        ("How far.", "How far it is."),
        ("A field.", "A column."),
        ("'''Return a length.'''", "'''Return\n    it.'''"),
        ("'''Return a length.'''\n    ", ""),
        ("a + b", "a+b"),
        ("(a, b)", "(\n    a,\n    b,\n)"),
        ("\n\n\n", "\n"),
        ("'", '"'),
        ("\n", "\r\n"),
    ],
)
def test_comments_docstrings_and_layout_are_not_digested(old, new):
    assert old in MODULE
    assert digest(MODULE.replace(old, new)) == digest(MODULE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.5", "0.6"),
        ("0.5", "0.50000001"),
        ("1.0", "1"),
        ("= 1.0", ""),
        ("a + b", "a - b"),
        ("a + b", "b + a"),
        ("a, b", "a, /, b"),
        ("a, b", "a, *, b"),
        ("a, b", "b, a"),
        ("a, b", "*a, b"),
        ("(1, 2)", "(2, 1)"),
        ("(1, 2)", "[1, 2]"),
        ("(1, 2)", "((1,), 2)"),
        ("(1, 2)", '("1", 2)'),
        ("(1, 2)", "(1, 2, None)"),
        ("(1, 2)", "(1, 2, ...)"),
        ('"a": ', 'b"a": '),
        (".2f", ".3f"),
        ("LIMIT_M:", "LIMIT_M!r:"),
        (' m"', ' m "'),
        ("LIMIT_M", "REACH_M"),
        ("float", "int"),
        ("import voxels", "import sides"),
        ("import voxels", "import voxels as v"),
        ("def measure", "@staticmethod\ndef measure"),
        ("return f", "yield f"),
        ("    '''Return a length.'''", "    said = '''Return a length.'''"),
    ],
)
def test_whatever_may_change_a_result_is_digested(old, new):
    assert old in MODULE
    assert digest(MODULE.replace(old, new)) != digest(MODULE)


def test_what_is_left_out_at_one_place_is_not_what_is_left_out_at_another():
    assert len({digest(text) for text in ("a[1:]", "a[:1]", "a[::1]", "a[1]")}) == 4


def test_the_digest_of_code_is_the_same_in_every_version_of_python():
    """Worked out once, with Python 3.11."""
    assert digest(MODULE) == "b7ebfce21ff7a5cadfd535fb5aa5f7396b1b732aa28af4b9cb668067606d575e"


def test_many_threads_may_digest_at_once():
    sources = [path.read_bytes() + b"#" for path in sorted((ROOT / "tasks/body").rglob("*.py"))]
    one_by_one = [fingerprints.code_digest(source) for source in sources]
    fingerprints._look_into.cache_clear()
    shutil.rmtree(fingerprints._KEPT)
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(fingerprints.code_digest, sources)) == one_by_one


def test_what_one_process_parsed_no_other_parses(monkeypatch):
    source = MODULE.encode() + b"\n"
    first = fingerprints.code_digest(source)
    fingerprints._look_into.cache_clear()
    with monkeypatch.context() as patched:
        patched.setattr(fingerprints, "_parse", lambda _: pytest.fail("parsed again"))
        assert fingerprints.code_digest(source) == first
    assert fingerprints.code_digest(source.replace(b"0.5", b"0.6")) != first


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"code": 1}', b"\xff", b"null"])
def test_what_was_kept_and_is_damaged_is_parsed_anew(damage):
    first = fingerprints.code_digest(MODULE.encode())
    (kept,) = fingerprints._KEPT.glob("*.json")
    kept.write_bytes(damage)
    fingerprints._look_into.cache_clear()
    assert fingerprints.code_digest(MODULE.encode()) == first
    assert b"imports" in kept.read_bytes()


def test_without_a_place_to_keep_it_the_digest_is_the_same(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    first = fingerprints.code_digest(MODULE.encode())
    monkeypatch.setattr(fingerprints, "_KEPT", tmp_path / "file" / "kept")
    fingerprints._look_into.cache_clear()
    assert fingerprints.code_digest(MODULE.encode()) == first


def test_what_is_imported_inside_a_function_counts():
    files = fingerprints.source_files("storage.archive")  # imports storage.arrays.groups on use
    assert "storage.arrays.groups" in files
    assert "tests" not in {name.split(".")[0] for name in files}


def test_the_imports_are_those_that_the_byte_code_of_all_files_makes():
    seen = 0
    for path in (ROOT / "tasks").rglob("*.py"):
        ours = {
            name
            for name in compiled_imports(compile(path.read_bytes(), str(path), "exec"))
            if name.split(".")[0] in ("tasks", "storage")
        }
        assert set(fingerprints._parse(path.read_bytes())[1]) == ours, path
        seen += len(ours)
    assert seen > 500


def compiled_imports(code):
    """Yield what byte code imports, and what it takes from that, which may be a module too."""
    module = ""
    for step in dis.get_instructions(code):
        if step.opname == "IMPORT_NAME":
            module = step.argval
            yield module
        elif step.opname == "IMPORT_FROM":
            yield f"{module}.{step.argval}"
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from compiled_imports(inner)


def test_what_cannot_be_named_is_refused():
    with pytest.raises(TypeError, match="cannot fingerprint"):
        fingerprints.fingerprint(index_take, {"array": object()})
