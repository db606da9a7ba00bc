"""Tests of tasks.engine.fingerprints."""

import ast
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tasks.engine import fingerprints
from tasks.retrieval.indexing import index_take
from tests.conftest import ROOT


@dataclass(frozen=True)
class Settings:
    scale: float = 1.0


@pytest.fixture(autouse=True)
def fresh():
    fingerprints._source_digest.cache_clear()
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


@pytest.mark.parametrize("name", ["tasks.retrieval.indexing", "tasks.retrieval.normalization"])
def test_an_edit_to_the_module_or_to_one_behind_it_gives_another_name(tmp_path, monkeypatch, name):
    before = fingerprints.fingerprint(index_take, {})
    edited = tmp_path / "edited.py"
    edited.write_text(Path(sys.modules[name].__file__).read_text() + "# edited\n")
    monkeypatch.setattr(sys.modules[name], "__file__", str(edited))
    fingerprints._source_digest.cache_clear()
    assert fingerprints.fingerprint(index_take, {}) != before


def test_what_is_imported_inside_a_function_counts():
    files = fingerprints.source_files("storage.archive")  # imports storage.arrays.groups on use
    assert "storage.arrays.groups" in files
    assert "tests" not in {name.split(".")[0] for name in files}


def test_the_imports_are_those_of_the_syntax_trees_of_all_files():
    """Byte code must show every import that the text has; `ast` is not safe in threads."""
    known = {}
    for path in (ROOT / "tasks").rglob("*.py"):
        names = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        ours = {name for name in names if name.split(".")[0] in ("tasks", "storage")}
        assert set(fingerprints._imported_names(path)) == ours, path
        known[path] = ours
    assert sum(map(len, known.values())) > 500


def test_what_cannot_be_named_is_refused():
    with pytest.raises(TypeError, match="cannot fingerprint"):
        fingerprints.fingerprint(index_take, {"array": object()})
