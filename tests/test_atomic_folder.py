"""A folder of results is whole or absent, whatever ends its writing."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from crowdfence.atomic_folder import replaceable_folder, whole_folder
from crowdfence.cli.demo import RECORDING
from support.command_line import crowdfence

CONTENTS = ("zones.json", "summary.json")


def write_both(folder: Path, text: str) -> None:
    for name in CONTENTS:
        (folder / name).write_text(text)


def held_by(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def old_result(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    write_both(folder, "old")
    return folder


@pytest.mark.parametrize("exists", [False, True])
def test_a_folder_appears_when_it_is_whole(tmp_path: Path, exists: bool) -> None:
    folder = tmp_path / "a" / "out"
    if exists:
        folder.mkdir(parents=True)
    with whole_folder(folder, contents=CONTENTS) as beside:
        write_both(beside, "new")
        assert not folder.exists() or list(folder.iterdir()) == []
    assert held_by(folder) == dict.fromkeys(CONTENTS, "new")
    assert list(folder.parent.iterdir()) == [folder]
    assert folder.stat().st_mode & 0o777 == 0o777 & ~os.umask(os.umask(0o022))


def test_what_is_there_is_replaced_only_by_force(tmp_path: Path) -> None:
    folder = old_result(tmp_path)
    for place in (replaceable_folder, whole_folder):
        with pytest.raises(FileExistsError, match="out exists; --force replaces it"):
            place(folder, contents=CONTENTS, force=False).__enter__()
    with whole_folder(folder, contents=CONTENTS, force=True) as beside:
        (beside / "summary.json").write_text("new")
    assert held_by(folder) == {"summary.json": "new"}  # nothing of the old one is left
    assert list(tmp_path.iterdir()) == [folder]


def test_a_folder_of_other_things_is_never_replaced(tmp_path: Path) -> None:
    folder = old_result(tmp_path)
    (folder / "thesis.tex").write_text("years of work")
    with (
        pytest.raises(FileExistsError, match=r"out holds thesis\.tex, which is no result"),
        whole_folder(folder, contents=CONTENTS, force=True),
    ):
        raise AssertionError
    assert (folder / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("held", [True, False])
def test_the_folder_that_one_is_in_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: bool
) -> None:
    """A shell would stand in a folder that is gone, and `ls` show nothing."""
    folder = old_result(tmp_path)
    if not held:
        for name in CONTENTS:
            (folder / name).unlink()
    monkeypatch.chdir(folder)
    for place in (replaceable_folder, whole_folder):
        with pytest.raises(OSError, match=r"cannot replace .*out: you are in it"):
            place(Path("."), contents=CONTENTS, force=True).__enter__()
    assert Path.cwd() == folder and len(held_by(folder)) == (2 if held else 0)


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    folder = old_result(tmp_path)
    link = tmp_path / "latest"
    link.symlink_to(folder)
    with whole_folder(link, contents=CONTENTS, force=True) as beside:
        write_both(beside, "new")
    assert link.is_symlink() and held_by(folder) == dict.fromkeys(CONTENTS, "new")


def test_a_full_disk_leaves_the_old_folder(tmp_path: Path) -> None:
    folder = old_result(tmp_path)
    with (
        pytest.raises(OSError, match=f"cannot write {folder}: No space left on device; nothing") as refused,
        whole_folder(folder, contents=CONTENTS, force=True) as beside,
    ):
        (beside / "zones.json").write_text("new")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(beside / "summary.json"))
    assert refused.value.errno == errno.ENOSPC
    assert held_by(folder) == dict.fromkeys(CONTENTS, "old")
    assert list(tmp_path.iterdir()) == [folder]


def test_a_result_that_appeared_meanwhile_is_kept(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with (
        pytest.raises(FileExistsError, match="--force"),
        whole_folder(folder, contents=CONTENTS) as beside,
    ):
        write_both(beside, "slow")
        folder.mkdir()
        write_both(folder, "fast")
    assert held_by(folder) == dict.fromkeys(CONTENTS, "fast")


def test_a_file_system_that_cannot_exchange_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda *_, **__: object())
    folder = old_result(tmp_path)
    with whole_folder(folder, contents=CONTENTS, force=True) as beside:
        write_both(beside, "new")
    assert held_by(folder) == dict.fromkeys(CONTENTS, "new")
    assert list(tmp_path.iterdir()) == [folder]


KILLED = """
import os, signal, sys
from pathlib import Path
from crowdfence import atomic_folder
def kill(*_): os.kill(os.getpid(), signal.SIGKILL)
moment = sys.argv[2]
if moment in ("_flush_to_disk", "_exchange"):
    setattr(atomic_folder, moment, kill)
with atomic_folder.whole_folder(sys.argv[1], contents=("zones.json", "summary.json"), force=True) as beside:
    (Path(beside) / "zones.json").write_text("new")
    if moment == "between the files":
        kill()
    (Path(beside) / "summary.json").write_text("new")
"""


@pytest.mark.parametrize("moment", ["between the files", "_flush_to_disk", "_exchange"])
def test_a_kill_leaves_the_old_folder_and_the_next_run_tidies_up(tmp_path: Path, moment: str) -> None:
    folder = old_result(tmp_path)
    done = subprocess.run([sys.executable, "-c", KILLED, folder, moment], check=False)
    assert done.returncode == -signal.SIGKILL
    assert held_by(folder) == dict.fromkeys(CONTENTS, "old")
    assert len(list(tmp_path.iterdir())) == 2
    with whole_folder(folder, contents=CONTENTS, force=True) as beside:
        assert {path.name for path in tmp_path.iterdir()} == {"out", beside.name}
        write_both(beside, "new")
    assert list(tmp_path.iterdir()) == [folder]


def test_a_folder_that_another_process_writes_is_not_tidied_up(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out", contents=CONTENTS) as slow:
        write_both(slow, "slow")
        with whole_folder(tmp_path / "out", contents=CONTENTS) as fast:
            write_both(fast, "fast")
        assert held_by(slow) == dict.fromkeys(CONTENTS, "slow")
        (tmp_path / "out").rename(tmp_path / "moved")
    assert held_by(tmp_path / "out") == dict.fromkeys(CONTENTS, "slow")


def test_a_run_on_a_full_disk_leaves_the_run_before(tmp_path: Path) -> None:
    """No file of the second run may hold more than 100 kB: its zones fit, its map does not."""
    output = tmp_path / "out"
    words = ["run", str(RECORDING), "--detector", "recorded", "-o", str(output)]
    assert crowdfence(*words).returncode == 0
    before = {path.name: path.read_bytes() for path in output.iterdir()}
    refused = crowdfence(*words)
    assert refused.returncode == 1 and f"{output} exists; --force replaces it" in refused.stderr
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        f"sys.argv = ['crowdfence', *{words}, '--force']\n"
        "from crowdfence.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"cannot write {output}: File too large; nothing there was changed" in done.stderr
    assert {path.name: path.read_bytes() for path in output.iterdir()} == before
    assert list(tmp_path.iterdir()) == [output]
