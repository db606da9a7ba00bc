"""An archive of four takes, and the command in this process."""

import pytest

from flows.command.main import main
from tests.figures.archives.imported import take_in_plainly


@pytest.fixture
def archive(tmp_path, write_walk):
    """Four takes, ingested by the very functions that the flow calls."""
    folder = tmp_path / "inbox"
    for number, name in enumerate(("okuri48", "okuri49", "lonely", "radio")):
        write_walk(folder / f"{name}.trc", seed=number, frames=80 + number)
    (folder / "okuri48.toml").write_text('[take]\ntitle = "Okuri 48"\nperformer = "TK"\n')
    return take_in_plainly(tmp_path / "archive", folder)


def run(capsys, *arguments):
    """Run the command in this process; return exit code, output and messages."""
    code = main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err
