"""Only regular files are opened: what would never end is refused before, whoever reads it."""

import os
import shutil
import socket

import numpy as np
import pytest

from flows.command.main import main
from storage import create_archive, open_archive
from storage.errors import ArchiveError, InputError
from storage.files import NotRegularError, open_regular
from storage.formats.calibration.reading import read_calibration
from storage.formats.capture.initial import read_initial
from storage.formats.motion.bvh import read_bvh
from storage.formats.motion.c3d import read_c3d
from storage.formats.motion.joint_map import read_joint_map
from storage.formats.motion.trc import read_trc
from storage.formats.settings_toml import read_settings_tables
from storage.recordings import find_recordings, plan_takes
from tests.figures.archives.takes import publish

READERS = {
    "c.toml": read_calibration,
    "i.json": read_initial,
    "m.bvh": read_bvh,
    "m.c3d": read_c3d,
    "m.toml": read_joint_map,
    "m.trc": read_trc,
    "s.toml": read_settings_tables,
}


def test_a_pipe_a_socket_and_a_device_are_not_opened(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket must be short
    os.mkfifo("pipe")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind("socket")
        os.symlink("pipe", "link")
        for name in ("pipe", "socket", "link", "/dev/zero"):
            with pytest.raises(NotRegularError, match="it is no regular file, but a"):
                open_regular(name)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    (tmp_path / "file").write_bytes(b"here")
    with open_regular(tmp_path / "file") as file:
        assert file.read() == b"here"


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_in_place_of_a_file_is_refused_by_its_reader(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=rf"{name} is no regular file, but a named pipe; bring"):
        READERS[name](tmp_path / name)


def test_pipes_among_recordings_are_refused_alone(tmp_path):
    inbox = tmp_path / "inbox"
    inbox.mkdir()
    (inbox / "good.bvh").write_text("the motion")
    (inbox / "side.bvh").write_text("another motion")
    os.mkfifo(inbox / "pipe.bvh")
    os.mkfifo(inbox / "side.toml")
    planned = plan_takes(create_archive(tmp_path / "archive"), find_recordings([inbox]))
    assert [each.take for each in planned.recordings] == ["good"]
    assert all("is no regular file, but a named pipe" in each.reason for each in planned.refusals)
    assert len(planned.refusals) == 2


@pytest.fixture
def archive(tmp_path):
    archive = create_archive(tmp_path / "archive")
    publish(archive.place, "okuri")
    return archive


def files_of(archive):
    return [path for path in sorted(archive.place.folder.rglob("*")) if path.is_file()]


def test_a_pipe_in_place_of_any_file_of_an_archive_is_named(archive, tmp_path, capsys):
    refused = 0
    for path in files_of(archive):
        name = path.relative_to(archive.place.folder)
        damaged = tmp_path / "damaged"
        shutil.copytree(archive.place.folder, damaged)
        (damaged / name).unlink()
        os.mkfifo(damaged / name)
        exit_code = main(["export", str(damaged), "okuri", str(tmp_path / "out.csv")])
        said = capsys.readouterr().err
        if exit_code:
            assert exit_code == 3, said
            assert "is no regular file, but a named pipe" in said
            refused += 1
        shutil.rmtree(damaged)
    assert refused > 3


def test_a_pipe_in_place_of_a_chunk_is_an_archive_error(archive):
    take = open_archive(archive.place.folder).take("okuri")
    chunk = max(archive.place.folder.glob("takes/**/c/**/*"), key=lambda path: len(path.parts))
    chunk.unlink()
    os.mkfifo(chunk)
    with pytest.raises(ArchiveError, match="no regular file, but a named pipe; remove it"):
        np.asarray(take.motion["position"])
