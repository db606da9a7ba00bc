"""The page of a day: what failed again and again is told once."""

from flows.service.summarizing import told_once


def test_what_failed_again_and_again_is_told_once():
    again = [("scan", f"no disk (tried again after {pause} s)") for pause in (240, 120, 60)]
    assert told_once([*again[:2], ("index", "broke"), again[2]]) == [
        ("scan", "no disk (3 times)"),
        ("index", "broke"),
    ]
