"""Tests of tasks.fingerprints."""

import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tasks import fingerprints
from tasks.indexing import index_take


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


@pytest.mark.parametrize("name", ["tasks.indexing", "tasks.retrieval.normalization"])
def test_an_edit_to_the_module_or_to_one_behind_it_gives_another_name(tmp_path, monkeypatch, name):
    before = fingerprints.fingerprint(index_take, {})
    edited = tmp_path / "edited.py"
    edited.write_text(Path(sys.modules[name].__file__).read_text() + "# edited\n")
    monkeypatch.setattr(sys.modules[name], "__file__", str(edited))
    fingerprints._source_digest.cache_clear()
    assert fingerprints.fingerprint(index_take, {}) != before


def test_what_is_imported_inside_a_function_counts():
    files = fingerprints.source_files("storage.archive")  # imports storage.arrays on use
    assert "storage.arrays" in files
    assert "tests" not in {name.split(".")[0] for name in files}


def test_what_cannot_be_named_is_refused():
    with pytest.raises(TypeError, match="cannot fingerprint"):
        fingerprints.fingerprint(index_take, {"array": object()})
