"""`crowdfence doctor`, the real command, on this machine and on ones that lack something."""

import json
import os
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

import crowdfence
from crowdfence.doctor import Package, check_folder, check_package
from support.command_line import crowdfence as command_line


def doctor(*arguments: str, hidden: Path | None = None, **variables: str) -> subprocess.CompletedProcess[str]:
    if hidden is not None:
        variables["PYTHONPATH"] = os.pathsep.join([str(hidden), os.environ.get("PYTHONPATH", "")])
    return command_line("doctor", *arguments, columns=100, **variables)


def hide(folder: Path, *modules: str) -> Path:
    """A folder that, first on the path, makes imports of these modules fail as if they were not installed."""
    for module in modules:
        lines = f'raise ModuleNotFoundError("No module named {module!r}", name={module!r})\n'
        (folder / f"{module}.py").write_text(lines)
    return folder


def checks_of(done: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in json.loads(done.stdout)["checks"]}


@pytest.fixture(scope="module")
def healthy() -> subprocess.CompletedProcess[str]:
    return doctor("--json")


def test_this_machine_is_ready(healthy: subprocess.CompletedProcess[str]) -> None:
    assert healthy.returncode == 0, healthy.stdout
    assert json.loads(healthy.stdout)["ok"] is True
    checks = checks_of(healthy)
    assert checks["Python"]["detail"].startswith(sys.version.split()[0])
    assert checks["compiled core"]["detail"].startswith(f"{crowdfence.__version__}, a view of 400 voxels")
    for name in ("numpy", "mcap", "pyproj", "rasterio", "shapely", "matplotlib", "PROJ", "GDAL"):
        assert (checks[name]["group"], checks[name]["state"]) == ("needed", "ok")
        assert checks[name]["remedy"] is None
    assert "network o" in checks["PROJ"]["detail"]
    assert "cores" in checks["processor"]["detail"]


def test_every_dependency_that_the_package_declares_is_tried(
    healthy: subprocess.CompletedProcess[str],
) -> None:
    declared = [Requirement(line) for line in requires("crowdfence") or []]
    here = {each.name for each in declared if each.marker is None or each.marker.evaluate({"extra": ""})}
    needed = {name for name, check in checks_of(healthy).items() if check["group"] == "needed"}
    assert len(here) > 5
    assert here <= needed


def test_a_missing_extra_names_its_command_and_does_not_fail(tmp_path: Path) -> None:
    hidden = hide(tmp_path, "laspy", "trimesh", "moderngl")
    done = doctor("--json", hidden=hidden)
    assert done.returncode == 0, done.stdout
    checks = checks_of(done)
    assert (checks["laspy"]["state"], checks["laspy"]["group"]) == ("missing", "optional")
    assert checks["laspy"]["remedy"] == "pip install 'crowdfence[lidar]'"
    assert checks["trimesh"]["remedy"] == "pip install 'crowdfence[mesh]'"
    assert checks["moderngl"]["remedy"] == "pip install 'crowdfence[sim]'"
    assert (checks["OpenGL (EGL)"]["detail"], checks["OpenGL (EGL)"]["remedy"]) == (
        "moderngl is missing",
        None,
    )
    text = doctor(hidden=hidden)
    assert text.returncode == 0
    assert "pip install 'crowdfence[lidar]'" in text.stdout.replace("\n   ", " ")
    assert "Everything that crowdfence needs works." in text.stdout


def test_a_missing_need_fails_and_names_only_itself(tmp_path: Path) -> None:
    done = doctor("--json", hidden=hide(tmp_path, "rasterio"))
    assert done.returncode == 1
    assert done.stderr == ""
    assert json.loads(done.stdout)["ok"] is False
    checks = checks_of(done)
    assert checks["rasterio"]["state"] == "missing"
    assert checks["rasterio"]["remedy"].startswith("pip install 'rasterio>=")
    assert (checks["GDAL"]["state"], checks["GDAL"]["detail"]) == ("broken", "rasterio is missing")
    failed = {name for name, check in checks.items() if check["group"] == "needed" and check["state"] != "ok"}
    assert failed == {"rasterio", "GDAL"}


def test_a_package_that_breaks_on_import_is_broken_not_missing(tmp_path: Path) -> None:
    (tmp_path / "shapely.py").write_text('raise OSError("libgeos_c.so.1: cannot open shared object file")\n')
    done = doctor(hidden=tmp_path)
    assert done.returncode == 1
    assert "libgeos_c.so.1" in done.stdout
    assert "pip install --force-reinstall 'shapely'" in done.stdout
    assert "A needed part does not work." in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_coordinate_data_of_another_program(tmp_path: Path) -> None:
    # A leftover variable that points PROJ to a folder without its database, as other installers set it.
    done = doctor("--json", PROJ_DATA=str(tmp_path), PROJ_LIB=str(tmp_path))
    checks = checks_of(done)
    assert done.returncode == 1
    assert "broken" in {checks["PROJ"]["state"], checks["GDAL"]["state"]}
    remedies = [checks[name]["remedy"] for name in ("PROJ", "GDAL") if checks[name]["state"] == "broken"]
    assert all("PROJ_LIB" in remedy for remedy in remedies)


def test_a_version_that_is_too_old() -> None:
    check = check_package(Package("numpy", "numpy", "arrays"), "1000.2")
    assert check.state == "broken"
    assert "older than 1000.2" in check.detail
    assert check.remedy == "pip install --upgrade 'numpy>=1000.2'"
    assert check_package(Package("numpy", "numpy", "arrays"), "1.9").state == "ok"  # 1.26 is not below 1.9


def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    assert check_folder(tmp_path).state == "ok"
    assert list(tmp_path.iterdir()) == []
    gone = check_folder(tmp_path / "gone")
    assert gone.state == "broken"
    assert "gone cannot be written to: No such file" in gone.detail
    assert gone.remedy == "name another folder with -o"
