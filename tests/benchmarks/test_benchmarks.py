"""Every benchmark can still be run: what it imports is there."""

import pkgutil
from importlib import import_module

from tests import benchmarks


def test_what_benchmarks_import_is_there():
    names = [each.name for each in pkgutil.walk_packages(benchmarks.__path__, "tests.benchmarks.")]
    assert "tests.benchmarks.history" in names
    for name in names:
        import_module(name)
