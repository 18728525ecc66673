"""`make` builds an environment of its own, and changes none that lies elsewhere."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).parents[1] / "Makefile"
SOURCES = ("requirements.txt", "requirements-train.txt", "Cargo.toml", "Cargo.lock", "pyproject.toml")


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.parametrize(
    ("marks", "changed"),
    [
        ([], "requirements.txt"),
        ([".installed", ".built", ".training"], "requirements.txt"),
        ([".installed"], "Cargo.toml"),
        ([".installed", ".built"], "requirements-train.txt"),
    ],
)
def test_an_environment_that_is_a_link_is_left_as_it_is(
    tmp_path: Path, marks: list[str], changed: str
) -> None:
    """What lies at its other end may be of somebody else: it was emptied, and got this core. Whatever would
    change it is replaced by a program that writes down how it was called."""
    here, other, called = tmp_path / "clone", tmp_path / "other", tmp_path / "called"
    (here / "crates").mkdir(parents=True)
    (other / "bin").mkdir(parents=True)
    program = other / "bin" / "python"
    program.write_text(f'#!{shutil.which("sh")}\necho "$@" >> {called}\n')
    program.chmod(0o755)
    (other / "bin" / "maturin").symlink_to(program)
    shutil.copy(MAKEFILE, here)
    begin_s = 1_000_000_000
    for number, path in enumerate([*(here / name for name in SOURCES), *(other / name for name in marks)]):
        path.touch()
        os.utime(path, (begin_s + number, begin_s + number))
    os.utime(here / changed, (begin_s + 100, begin_s + 100))
    (here / ".venv").symlink_to(other)
    words = ["make", "setup-training", f"PYTHON={program}"]
    # The tests may run in a make, whose options are not those of this one.
    inherited = ("MAKEFLAGS", "MAKEOVERRIDES", "MAKELEVEL", "MFLAGS")
    environment = {name: value for name, value in os.environ.items() if name not in inherited}
    done = subprocess.run(
        words, cwd=here, env=environment, capture_output=True, text=True, check=False, timeout=60.0
    )
    assert not called.exists(), called.read_text()
    assert done.returncode != 0 and ".venv is a symbolic link" in done.stderr + done.stdout
    assert sorted(one.name for one in other.iterdir()) == sorted(["bin", *marks])
