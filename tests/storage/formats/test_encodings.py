"""Encodings: what people write is read as they wrote it, and what cannot be told is refused."""

import unicodedata

import pytest

from storage.errors import InputError
from storage.formats import read_motion_file
from storage.formats.encodings import find_encoding
from tests.storage.formats.motion.test_bvh import WHOLE as BVH
from tests.storage.formats.motion.test_trc import WHOLE as TRC

JAPANESE = (
    "左ひざ 右ひざ",
    "首",
    "センター 上半身 左足ＩＫ",
    "頭 End",
    "ﾋｻﾞ 左手首",
    "腰 L腕",
    "左踵",
)
WESTERN = ("Hüfte", "Tête Épaule", "coração", "Ça va à gauche", "naïve 45°", "Füße")
OTHERS = (
    ("左膝 右膝 头", "gbk"), ("左膝 右膝 頭", "big5"), ("왼쪽무릎 머리 팔", "cp949"),
    ("Колено Таз Голова", "cp1251"), ("Таз", "cp1251"), ("Колено Таз", "koi8-r"),
    ("γόνατο", "cp1253"),
    ("左ひざ 右ひざ", "euc_jp"), ("Tête genou arrière Épaule", "mac_roman"),
)  # fmt: skip


@pytest.mark.parametrize("text", JAPANESE)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp932"])
def test_japanese_is_decoded_as_it_was_written(text, encoding):
    assert find_encoding(text.encode(encoding)) == encoding
    assert find_encoding(text.encode()) == "utf-8-sig"


@pytest.mark.parametrize("text", WESTERN)
def test_western_names_are_latin_1(text):
    assert find_encoding(text.encode("latin-1")) == "latin-1"


@pytest.mark.parametrize(("text", "encoding"), OTHERS)
def test_what_could_be_several_is_not_guessed(text, encoding):
    assert find_encoding(text.encode(encoding)) is None


@pytest.mark.parametrize(("suffix", "whole", "old"), [("bvh", BVH, "arm"), ("trc", TRC, "A\t\t\t")])
@pytest.mark.parametrize(
    ("name", "encoding"), [("左ひざ", "cp932"), ("右手首", "utf-16"), ("ガメラ", "utf-8")]
)
def test_a_motion_file_has_the_names_that_were_written(
    tmp_path, suffix, whole, old, name, encoding
):
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(whole.replace(old, old.replace(old.strip(), name)).encode(encoding))
    motion = read_motion_file(path)
    assert name in motion.names
    assert [note for note in motion.notes if "cp932" in note] == (
        ["The file is not in UTF-8; its names were read as cp932 (Japanese Windows)."]
        if encoding == "cp932"
        else []
    )


@pytest.mark.parametrize(("suffix", "whole"), [("bvh", BVH), ("trc", TRC)])
def test_composed_and_decomposed_names_are_read_as_one(tmp_path, suffix, whole):
    for form in ("NFC", "NFD"):
        name = unicodedata.normalize(form, "ガメラ")
        text = whole.replace("arm", name).replace("A\t\t\t", f"{name}\t\t\t")
        (tmp_path / f"x.{suffix}").write_text(text, encoding="utf-8")
        assert "ガメラ" in read_motion_file(tmp_path / f"x.{suffix}").names


@pytest.mark.parametrize(("suffix", "whole"), [("bvh", BVH), ("trc", TRC)])
def test_names_in_an_encoding_that_cannot_be_told_are_refused(tmp_path, suffix, whole):
    path = tmp_path / f"x.{suffix}"
    path.write_bytes(whole.replace("arm", "左膝").replace("A\t\t\t", "左膝\t\t\t").encode("gbk"))
    with pytest.raises(InputError, match=r"nor UTF-16, cp932 .* or Latin-1; save it as UTF-8"):
        read_motion_file(path)


@pytest.mark.data
def test_the_bones_of_mikumikudance_are_the_same_in_cp932_as_in_utf_8(shared_data):
    folder = shared_data / "reports" / "R04"
    old, new = (read_motion_file(folder / f"mmd_{form}.bvh") for form in ("cp932", "utf-8"))
    assert old.names == new.names
    assert "左ひざ" in new.names
    assert (old.position == new.position).all()
