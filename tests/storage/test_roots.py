"""What forms name and links lead to stays in the folders that are served."""

import pytest

from storage.errors import InputError
from storage.roots import check_within, links_out


def test_paths_of_forms_stay_in_the_roots(tmp_path):
    root, secret = tmp_path / "root", tmp_path / "secret"
    for folder in (root / "sub", secret):
        folder.mkdir(parents=True)
        (folder / "a.bvh").write_bytes(b"x")
    (root / "link.bvh").symlink_to(secret / "a.bvh")
    (root / "loop").symlink_to(root / "loop")
    roots = [str(root)]
    assert check_within("sub/a.bvh", roots) == str(root / "sub" / "a.bvh")
    assert check_within(str(root / "sub" / ".." / "sub"), roots) == str(root / "sub")
    for path in (
        str(secret / "a.bvh"), "../secret/a.bvh", str(root / ".." / "secret"), "link.bvh", "loop",
        "/etc/passwd", "/etc/absent", str(tmp_path / "root2"), "s3://bucket/x",
    ):  # fmt: skip
        with pytest.raises(InputError, match=r"does not lie in .*nothing else is read"):
            check_within(path, roots)
    for path, said in (("", "is no path"), ("a\0b", "is no path"), ("sub/b.bvh", "not there")):
        with pytest.raises(InputError, match=said):
            check_within(path, roots)
    with pytest.raises(InputError, match=r"link.bvh is a link that leads out"):
        check_within(str(root), roots)
    assert check_within(str(root / "link.bvh"), [*roots, str(secret)])
    assert list(links_out(root / "sub", roots)) == []


def test_urls_of_forms_stay_in_the_roots():
    roots = ["s3://bucket/inbox"]
    assert check_within("S3://bucket/inbox/./a", roots) == "s3://bucket/inbox/a"
    for url in ("s3://bucket/inbox/../other", "s3://bucket/inbox2/a", "file:///etc/passwd"):
        with pytest.raises(InputError, match="does not lie in"):
            check_within(url, roots)
