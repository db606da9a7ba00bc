"""One scan of an inbox and one server of an archive at a time, also where one died."""

import os
import threading
import time

import pytest

from storage.inbox.lock import BusyError, scanning, serving


def test_one_scan_at_a_time(inbox, archive):
    with scanning(archive.place, inbox, beat_s=0.02) as is_held:
        with pytest.raises(BusyError, match="is being scanned by process"):
            scanning(archive.place, inbox, dead_s=60).__enter__()
        assert is_held()
    with scanning(archive.place, inbox, dead_s=60):  # at once: it was let go
        pass
    assert len(list((archive.place.folder / "inbox" / inbox.key).iterdir())) == 1


def test_one_server_of_an_archive_at_a_time_and_it_stops_no_scan(inbox, archive):
    with serving(archive, beat_s=0.02) as is_held, scanning(archive.place, inbox):
        said = f"{archive.location} is being served by process {os.getpid()} on "
        with pytest.raises(BusyError, match=said):
            serving(archive, dead_s=60).__enter__()
        assert is_held()
    with serving(archive, dead_s=60):  # at once: it was let go
        pass


def test_the_lock_of_a_dead_scan_is_taken_over_by_one_and_the_dead_one_knows(inbox, archive):
    with scanning(archive.place, inbox, beat_s=3600) as dead_holds:
        got = []

        def ask():
            try:
                with scanning(archive.place, inbox, beat_s=3600, dead_s=0.3) as is_held:
                    got.append(is_held())
                    time.sleep(1)
            except BusyError:
                got.append(False)

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(got) == [False, False, False, True]
        assert dead_holds()  # it has not looked
    with scanning(archive.place, inbox, beat_s=0.02) as is_held:
        (archive.place.folder / "inbox" / inbox.key / "000000099").write_bytes(b"other")
        deadline = time.monotonic() + 60
        while is_held():
            assert time.monotonic() < deadline
            time.sleep(0.01)
