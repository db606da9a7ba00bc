"""Work on many things at once keeps their order, and does each once."""

import pytest

from tasks.engine.threads import side_by_side


@pytest.mark.parametrize("count", [0, 1, 2, 7, 50, 333])
def test_each_is_worked_on_once_in_order(count):
    seen = []

    def work(n):
        seen.append(n)
        return n * n

    assert side_by_side(work, range(count)) == [n * n for n in range(count)]
    assert sorted(seen) == list(range(count))


def test_what_goes_wrong_is_raised():
    def work(n):
        if n == 40:
            raise ValueError("forty")

    with pytest.raises(ValueError, match="forty"):
        side_by_side(work, range(80))
