"""What `make wheel` makes: the whole package, for machines without Rust, Node and this repository."""

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_a_wheel_holds_core_models_demo_and_page(tmp_path: Path) -> None:
    maturin = Path(sys.executable).with_name("maturin")
    subprocess.run(
        [maturin, "build", "--release", "--locked", "--quiet", "--out", tmp_path], cwd=ROOT, check=True
    )
    (wheel,) = tmp_path.glob("crowdfence-*-cp310-abi3-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    tracked = subprocess.run(
        ["git", "ls-files", "python"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert {path.removeprefix("python/") for path in tracked.stdout.split()} <= held
    assert {"crowdfence/_core.abi3.so", "crowdfence/service/page/index.html"} <= held
    assert not any("__pycache__" in name for name in held)
