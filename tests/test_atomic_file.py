"""Whether files can be written is known before the work, and nothing is left behind.

The tests may run as root, who writes where permissions forbid it: what fails here fails for everyone.
"""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from crowdfence.atomic_file import atomic_path, replaceable_file, writable_folder, write_bytes
from support.command_line import commands, crowdfence
from support.onnx_models import contract, write_map_model


def everything_below(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_folder_is_made_and_stays_when_something_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    with writable_folder(folder, parents=True):
        assert everything_below(tmp_path) == ["a", "a/b"]  # without the proof
        (folder / "zones.geojson").write_text("{}")
    assert everything_below(tmp_path) == ["a", "a/b", "a/b/zones.geojson"]


def test_folders_that_were_made_for_nothing_are_removed_again(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with (
        pytest.raises(ValueError, match="no frame"),
        writable_folder(tmp_path / "mine" / "a" / "b", parents=True),
    ):
        raise ValueError("no frame")
    assert everything_below(tmp_path) == ["mine"]
    with writable_folder(tmp_path / "mine"):
        pass
    assert everything_below(tmp_path) == ["mine"]  # empty too, but not made here


def test_a_mistyped_path_is_noticed(tmp_path: Path) -> None:
    with (
        pytest.raises(FileNotFoundError, match=r"typo/out: .*typo does not exist"),
        writable_folder(tmp_path / "typo" / "out"),
    ):
        raise AssertionError
    with (
        pytest.raises(FileNotFoundError, match="typo does not exist"),
        replaceable_file(tmp_path / "typo" / "out" / "a.mcap", force=False),
    ):
        raise AssertionError
    with replaceable_file(tmp_path / "out" / "a.mcap", force=False):
        (tmp_path / "out" / "a.mcap").touch()
    assert everything_below(tmp_path) == ["out", "out/a.mcap"]


def test_files_and_folders_are_not_mistaken_for_each_other(tmp_path: Path) -> None:
    (tmp_path / "notes").touch()
    for folder in (tmp_path / "notes", tmp_path / "notes" / "out"):
        with pytest.raises(NotADirectoryError, match="notes"), writable_folder(folder, parents=True):
            raise AssertionError
    with pytest.raises(IsADirectoryError, match="is a folder"), replaceable_file(tmp_path, force=True):
        raise AssertionError
    assert everything_below(tmp_path) == ["notes"]


@pytest.mark.parametrize(
    ("call", "error"), [("write", errno.ENOSPC), ("mkdir", errno.EROFS), ("mkdir", errno.EACCES)]
)
def test_what_the_system_refuses_is_one_line_with_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, error: int
) -> None:
    """Disks that are full or read-only, and folders of others, as the system reports them."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(error, os.strerror(error))

    # `fsync` stands for the write: an unbuffered file writes in C. Paths had their own `mkdir` until 3.10.
    for place, name in {"write": [(os, "fsync")], "mkdir": [(os, "mkdir"), (Path, "mkdir")]}[call]:
        monkeypatch.setattr(place, name, refuse)
    with (
        pytest.raises(OSError, match=f"out: {os.strerror(error)}") as refused,
        writable_folder(tmp_path / "out"),
    ):
        raise AssertionError
    assert refused.value.errno == error
    assert everything_below(tmp_path) == []


def test_a_write_that_really_fails_is_noticed(tmp_path: Path) -> None:
    """No file of this process may hold a byte."""
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
        "from crowdfence.atomic_file import writable_folder\n"
        "with writable_folder(sys.argv[1]): print('began')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "out"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and done.stdout == ""
    assert f"cannot write into {tmp_path / 'out'}: File too large" in done.stderr
    assert everything_below(tmp_path) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_noticed(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    for folder in (locked, locked / "out"):
        with pytest.raises(PermissionError, match=r"locked.*Permission denied"), writable_folder(folder):
            raise AssertionError


COMMANDS = {
    "run": ["run", "nowhere.mcap", "-o", "{place}/out"],
    "demo": ["demo", "-o", "{place}/out"],
    "convert": ["convert", "nowhere.mcap", "-o", "{place}/a.mcap"],
    "simulate": ["simulate", "race", "-o", "{place}/a.mcap"],
    "simulate to a folder": ["simulate", "race", "--format", "airsim", "-o", "{place}/a"],
    "detect": ["detect", "{pictures}", "-o", "{place}/out"],
    "detect in a recording": ["detect", "{damaged}", "-o", "{place}/a.mcap"],
    "inspect": ["inspect", "nowhere.mcap", "--picture", "{place}/a.png"],
    "calibrate": ["calibrate", "{model}", "--data", "nowhere.mcap", "-o", "{place}/a.onnx"],
    "model evaluate": ["model", "evaluate", "--data", "nowhere.mcap", "--examples", "{place}/a.png"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_look_at_their_output_before_their_input(tmp_path: Path, command: str) -> None:
    """The recordings are missing or damaged, and nobody gets so far as to notice."""
    (tmp_path / "file").touch()
    (tmp_path / "pictures").mkdir()
    (tmp_path / "damaged.mcap").write_bytes(b"not MCAP")
    places = {
        "place": tmp_path / "file",
        "pictures": tmp_path / "pictures",
        "damaged": tmp_path / "damaged.mcap",
        "model": write_map_model(tmp_path / "model.onnx", contract("logits")),
    }
    done = crowdfence(*(argument.format(**places) for argument in COMMANDS[command]))
    assert done.returncode == 1 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert str(tmp_path / "file") in line and ("it is a file" in line or "Not a directory" in line)


REPLACING = {
    "run": ["run", "nowhere.mcap", "-o", "{run}"],
    "convert": ["convert", "nowhere.mcap", "-o", "{place}.mcap"],
    "align": ["align", "nowhere.mcap", "-o", "{place}.json"],
    "detect": ["detect", "{damaged}", "-o", "{place}.mcap"],
    "inspect": ["inspect", "nowhere.mcap", "--picture", "{place}.png"],
    "evaluate": ["evaluate", "nowhere.mcap", "--report", "{report}"],
    "export": ["export", "nowhere", "-f", "kml", "-o", "{place}.kml"],
    "route": ["route", "nowhere", "--from", "0,0", "--to", "1,1", "-o", "{place}.geojson"],
    "route picture": ["route", "nowhere", "--from", "0,0", "--to", "1,1", "--picture", "{place}.png"],
    "fence pull": ["fence", "pull", "--link", "nowhere", "-o", "{place}.geojson"],
    "calibrate": ["calibrate", "{model}", "--data", "nowhere.mcap", "-o", "{place}.onnx"],
    "train": ["train", "--data", "a.mcap", "--validation", "b.mcap", "-o", "{place}.onnx"],
    "model check": ["model", "check", "nowhere.onnx", "--overlay", "{place}.png"],
    "model evaluate": ["model", "evaluate", "--data", "nowhere.mcap", "--examples", "{place}.png"],
    "model quantize": ["model", "quantize", "{model}", "--data", "nowhere.mcap", "-o", "{place}.onnx"],
    "model finer": ["model", "finer", "{model}", "--data", "nowhere.mcap", "-o", "{place}.onnx"],
}
WRITES = {"--output", "--picture", "--overlay", "--examples", "--report"}


@pytest.mark.parametrize("command", REPLACING)
def test_commands_replace_what_is_there_only_when_told_to(tmp_path: Path, command: str) -> None:
    """It is known before the work: what they read is missing or damaged; without --force nobody notices."""
    earlier = [tmp_path / "run" / "summary.json", tmp_path / "report" / "scores.json"]
    earlier += [tmp_path / f"a.{suffix}" for suffix in ("mcap", "json", "png", "kml", "geojson", "onnx")]
    for path in earlier:
        path.parent.mkdir(exist_ok=True)
        path.write_text("earlier")
    (tmp_path / "damaged.mcap").write_bytes(b"not MCAP")
    model = write_map_model(tmp_path / "model.onnx", contract("logits"))
    places = {name: tmp_path / name for name in ("run", "report")}
    places |= {"place": tmp_path / "a", "damaged": tmp_path / "damaged.mcap", "model": model}
    words = [argument.format(**places) for argument in REPLACING[command]]
    there = everything_below(tmp_path)
    done = crowdfence(*words, columns=300)
    assert done.returncode == 1 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert f"{words[-1]} exists; --force replaces it" in line
    told = crowdfence(*words, "--force", columns=300)
    assert told.returncode == 1 and "exists" not in told.stderr and len(told.stderr.splitlines()) == 1
    assert everything_below(tmp_path) == there and {path.read_text() for path in earlier} == {"earlier"}


def test_every_command_that_writes_is_told_whether_to_replace() -> None:
    """`data import` only adds to what is empty."""
    writing = {name for name, options in commands().items() if options & WRITES} - {"data import"}
    assert {name for name in writing if "--force" not in commands()[name]} == set()
    named = {command.removesuffix(" picture") for command in REPLACING}
    # `demo` writes as `run` does, `simulate` tells of --resume, too.
    assert writing == named | {"demo", "simulate"}


def test_a_training_goes_on_or_begins_anew_only_when_told_to(tmp_path: Path) -> None:
    """Hours of work are in the checkpoint. --resume without one is no way to replace another model."""
    words = ("train", "--data", "a.mcap", "--validation", "b.mcap", "-o", tmp_path / "a.onnx")
    (tmp_path / "a.checkpoint").write_text("hours")
    done = crowdfence(*words, columns=300)
    assert done.returncode == 1
    assert "a.checkpoint exists; --resume goes on with it, --force replaces it" in done.stderr
    for option in ("--resume", "--force"):
        assert "exists" not in crowdfence(*words, option, columns=300).stderr
    (tmp_path / "a.onnx").write_text("model")
    assert "exists" not in crowdfence(*words, "--resume", columns=300).stderr
    (tmp_path / "a.checkpoint").unlink()
    assert "a.onnx exists; --force" in crowdfence(*words, "--resume", columns=300).stderr


def test_a_link_stays_a_link_and_leads_to_what_was_written(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "real.kml").write_text("old")
    links = {"to_file.kml": "kept/real.kml", "to_link.kml": "to_file.kml", "to_nothing.kml": "kept/new.kml"}
    for name, target in links.items():
        (tmp_path / name).symlink_to(target)
        with replaceable_file(tmp_path / name, force=True):
            write_bytes(tmp_path / name, name.encode())
        assert (tmp_path / name).is_symlink() and (tmp_path / name).read_text() == name
    assert (tmp_path / "kept" / "real.kml").read_text() == "to_link.kml"
    assert (tmp_path / "kept" / "new.kml").read_text() == "to_nothing.kml"
    assert everything_below(tmp_path / "kept") == ["new.kml", "real.kml"]


def test_what_is_no_file_is_never_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.kml")
    (tmp_path / "to_pipe.kml").symlink_to("pipe.kml")
    (tmp_path / "ring.kml").symlink_to("ring.kml")
    for name, why in (
        ("pipe.kml", "a device or a pipe"),
        ("to_pipe.kml", "a device or a pipe"),
        ("ring.kml", "a link that leads to itself"),
    ):
        before = os.lstat(tmp_path / name)
        with pytest.raises(OSError, match=f"{name} is {why}"), replaceable_file(tmp_path / name, force=True):
            raise AssertionError
        with pytest.raises(OSError, match=f"{name} is {why}"):
            write_bytes(tmp_path / name, b"lost")
        assert os.lstat(tmp_path / name) == before
    assert len(everything_below(tmp_path)) == 3


def test_what_is_read_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "history.jsonl").write_text("{}")
    (tmp_path / "link.kml").symlink_to("history.jsonl")
    os.link(tmp_path / "history.jsonl", tmp_path / "same.kml")
    for name in ("history.jsonl", "link.kml", "same.kml"):
        with (
            pytest.raises(FileExistsError, match=f"{name} is read for this"),
            replaceable_file(
                tmp_path / name, force=True, reads=[None, tmp_path / "absent", tmp_path / "history.jsonl"]
            ),
        ):
            raise AssertionError
    with replaceable_file(tmp_path / "other.kml", force=False, reads=[tmp_path / "history.jsonl"]):
        pass


def test_a_disk_that_is_full_on_the_way_names_the_file(tmp_path: Path) -> None:
    """The system's own error of a write says neither which file nor what became of the one before."""
    target = tmp_path / "flight.mcap"
    target.write_bytes(b"before")
    with pytest.raises(OSError) as refused, atomic_path(target) as temporary:
        temporary.write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert refused.value.errno == errno.ENOSPC
    assert refused.value.strerror == (
        f"cannot write {target}: No space left on device; nothing there was changed"
    )
    assert everything_below(tmp_path) == ["flight.mcap"] and target.read_bytes() == b"before"
