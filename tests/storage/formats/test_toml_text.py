"""TOML of anybody: what is good is read, what would cost hours or gigabytes is refused before."""

import json
import tracemalloc

import pytest

from storage.errors import InputError
from storage.formats.toml_text import plain_metadata, read_toml

WANTED = "a file of the test"


def read(tmp_path, content):
    path = tmp_path / "a.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_toml(path, WANTED)


def test_what_is_usual_is_read_with_a_byte_order_mark_and_foreign_line_ends(tmp_path):
    text = '[take]\r\ntitle = "春の海"\r\n[a."b.c".d]\r\nx = [[1.5, 2.5], [-3.0, 4.0]]\r\n'
    for mark in (b"", b"\xef\xbb\xbf"):
        tables = read(tmp_path, mark + text.encode())
        assert tables["take"] == {"title": "春の海"}
        assert tables["a"]["b.c"]["d"]["x"] == [[1.5, 2.5], [-3.0, 4.0]]


@pytest.mark.parametrize(
    "text",
    [
        "x = [" + ", ".join("1.5" for _ in range(500)) + "]",
        'x = "' + "a." * 500 + '"',
        "# " + "[" * 500,
        "x = '" + "[" * 500 + "'",
        'x = """' + "\n[[\n{{ a.b.c = " * 100 + '"""',
        "x = '''" + "\n'[[\n" * 100 + "'''",
        '"' + "a." * 100 + '" = 1',
        "\n".join(f"a{n}.b.c = {n}" for n in range(500)),
        "\n".join(f"[[a]]\nx = [{n}]" for n in range(500)),
    ],
)
def test_long_and_flat_texts_are_read(tmp_path, text):
    read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a." * 50_000 + "a = 1", "'a.a.a.*' has more than 16 parts"),
        ("[" + "a . " * 50_000 + "a]", "has more than 16 parts"),
        ('"x,y".' * 20_000 + "a = 1", "has more than 16 parts"),
        ("x = {" + "'.'.a." * 10_000 + "a = 1}", "has more than 16 parts"),
        ("a = " + "[" * 50_000, "more than 16 deep in each other"),
        ("a = " + "[\n" * 40_000 + "]\n" * 40_000, "more than 16 deep in each other"),
        ("x" + "={x" * 40_000, "more than 16 deep in each other"),
        ("a = " + "9" * 5_000, "whole number of too many digits under 'a'"),
        ("[t]\na = 0x" + "f" * 5_000, "whole number of too many digits under 't.a'"),
        ("[t]\na = [1, {b = 9223372036854775808}]", "too many digits under 't.a.b'"),
        ("#" * (1 << 22), "is longer than 2,097,152 bytes"),
        (b"\xff\xfea\0=\0", "is not in UTF-8 but looks like UTF-16; save it as UTF-8"),
        (
            "a = '所作'".encode("cp932"),
            r"is not in UTF-8 but looks like cp932 .Japanese Windows.; save it",
        ),
        ("a = ", "is not TOML"),
    ],
)
def test_what_is_no_file_of_ours_is_refused_at_little_cost(tmp_path, text, message):
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=message):
            read(tmp_path, text)
        largest = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert largest < 50 * (len(text) + 2**16)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no regular file, but a folder"):
        read_toml(tmp_path, WANTED)


def test_metadata_become_strict_json(tmp_path):
    table = read(tmp_path, 'a = 2026-03-02\nb = [1, 2.5, true]\nc = {d = "所作"}\nt = 10:20:30')
    assert plain_metadata(table, "x") == {
        "a": "2026-03-02", "b": [1, 2.5, True], "c": {"d": "所作"}, "t": "10:20:30",
    }  # fmt: skip
    json.dumps(plain_metadata(table, "x"), allow_nan=False)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "+nan", "1e999"])
@pytest.mark.parametrize("shape", ["{}", "[0, {}]", "{{c = {{d = {}}}}}"])
def test_numbers_that_are_not_finite_are_refused_by_name(tmp_path, value, shape):
    table = read(tmp_path, f"a = 1\nb = {shape.format(value)}")
    with pytest.raises(InputError, match=r"^'b(\.c\.d)?' in \[take\] is not a finite number"):
        plain_metadata(table, "[take]")
