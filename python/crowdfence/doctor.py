"""What works on this machine, what is missing, and the command that installs it.

Everything is tried, not just looked up: packages are imported, the core projects a view, PROJ and GDAL each
do a little work whose result is known. A check never raises; whatever goes wrong is its finding.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from crowdfence.errors import one_line
from crowdfence.usable_cores import usable_cores

State = Literal["ok", "missing", "broken"]
Group = Literal["needed", "optional", "machine"]


@dataclass(frozen=True, slots=True)
class Check:
    """One finding."""

    group: Group
    name: str
    state: State
    detail: str
    remedy: str | None = None
    """What to type or do when the state is not ok."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All findings; `ok` when everything in the group "needed" is."""

    ok: bool
    checks: tuple[Check, ...]


@dataclass(frozen=True, slots=True)
class Package:
    """A dependency: what is imported to try it, what it is for, and the extra that brings it."""

    distribution: str
    module: str
    purpose: str
    extra: str | None = None


PACKAGES = (
    Package("numpy", "numpy", "arrays"),
    Package("mcap", "mcap.reader", "mission files"),
    Package("mcap-ros2-support", "mcap_ros2.decoder", "mission files"),
    Package("pillow", "PIL.Image", "heatmaps and images"),
    Package("pyproj", "pyproj", "coordinates on Earth"),
    Package("pyyaml", "yaml", "calibration files of cameras"),
    Package("rasterio", "rasterio", "GeoTIFF in and out"),
    Package("scipy", "scipy.ndimage", "landing prior, ground from lidar"),
    Package("shapely", "shapely", "zones"),
    Package("matplotlib", "matplotlib.figure", "picture of the map"),
    Package("onnxruntime", "onnxruntime", "crowd detector"),
    Package("typer", "typer", "command line"),
    Package("rich", "rich.console", "command line"),
    # Python has it built in since 3.11, as tomllib.
    *([Package("tomli", "tomli", "configuration files")] if sys.version_info < (3, 11) else ()),
    Package("laspy", "laspy", "lidar maps (.las .laz)", extra="lidar"),
    Package("lazrs", "lazrs", "compressed lidar maps (.laz)", extra="lidar"),
    Package("trimesh", "trimesh", "mesh maps (.ply .obj)", extra="mesh"),
    Package("opencv-python-headless", "cv2", "crowdfence align", extra="align"),
    Package("moderngl", "moderngl", "pictures of the simulator", extra="sim"),
    Package("av", "av", "videos in and out, damaged JPEGs told", extra="video"),
    Package("rosbags", "rosbags.highlevel", "bags of ROS", extra="ros"),
    Package("eclipse-zenoh", "zenoh", "fleets of ROS 2", extra="zenoh"),
    Package("fastapi", "fastapi", "live service", extra="serve"),
    Package("uvicorn", "uvicorn", "live service", extra="serve"),
    Package("websockets", "websockets", "live service", extra="serve"),
    Package("prometheus-client", "prometheus_client", "live service", extra="serve"),
    Package("httpx", "httpx", "client of the live service", extra="serve"),
    Package("pyulog", "pyulog", "flight logs of PX4 (.ulg)", extra="ulog"),
    Package("pymavlink", "pymavlink.mavutil", "MAVLink: flight logs (.tlog), fences", extra="mavlink"),
    Package("onnx", "onnx", "training and calibration of detectors", extra="train"),
    Package("torch", "torch", "training of detectors", extra="train"),
)


def diagnose(tell: Callable[[str], None] = lambda step: None) -> Diagnosis:
    """Try everything. `tell` is called with the name of each check before it runs."""
    checks = tuple(_checks(tell))
    return Diagnosis(all(check.state == "ok" for check in checks if check.group == "needed"), checks)


def _checks(tell: Callable[[str], None]) -> Iterator[Check]:
    minimums = _minimum_versions()
    tell("Python and the compiled core")
    yield check_python()
    yield _tried("needed", "compiled core", _core, "make setup (rebuilds it), or install crowdfence again")
    for package in PACKAGES:
        tell(package.distribution)
        yield check_package(package, minimums.get(package.distribution))
    tell("PROJ and GDAL")
    yield _tried("needed", "PROJ", _proj, _elsewhere("pyproj", "PROJ_DATA and PROJ_LIB"))
    yield _tried("needed", "GDAL", _gdal, _elsewhere("rasterio", "GDAL_DATA, PROJ_DATA and PROJ_LIB"))
    yield check_geoid()
    tell("OpenGL")
    yield check_opengl()
    tell("machine")
    yield Check("machine", "processor", "ok", f"{usable_cores()} cores, {platform.machine()}")
    yield Check("machine", "memory", "ok", _memory())
    yield check_folder(Path.cwd())


def check_python() -> Check:
    """The interpreter that runs this; one that is too old does not come this far."""
    return Check("needed", "Python", "ok", f"{platform.python_version()} ({sys.executable})")


def check_package(package: Package, minimum: str | None) -> Check:
    """Import it; `minimum` is the lowest version that crowdfence asks for."""
    name = package.distribution
    group: Group = "optional" if package.extra else "needed"
    wanted = f"crowdfence[{package.extra}]" if package.extra else f"{name}>={minimum}" if minimum else name
    install = f"pip install '{wanted}'"
    try:
        module = importlib.import_module(package.module)
    except ModuleNotFoundError as error:
        if f"{package.module}.".startswith(f"{error.name}."):
            return Check(group, name, "missing", package.purpose, install)
        return Check(group, name, "broken", f"{package.purpose}: {_told(error)}", install)
    except Exception as error:  # a broken package may raise anything
        reinstall = f"pip install --force-reinstall '{name}'"
        return Check(group, name, "broken", f"{package.purpose}: {_told(error)}", reinstall)
    try:
        version = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        version = str(getattr(module, "__version__", "unknown version"))
    if minimum is not None and _numbers(version) < _numbers(minimum):
        detail = f"{package.purpose}: {version} is older than {minimum}"
        return Check(group, name, "broken", detail, f"pip install --upgrade '{name}>={minimum}'")
    return Check(group, name, "ok", f"{version}, {package.purpose}")


def check_geoid() -> Check:
    """Heights above sea level need a geoid grid; PROJ ships without."""
    from crowdfence.georeference import Georeference

    name = "geoid grid (EGM96)"
    purpose = "maps and anchors with heights above sea level"
    try:
        Georeference(46.5, 8.0, 0.0).local_from_projected("EPSG:4326+5773", 8.0, 46.5, 0.0)
    except ValueError:
        return Check("optional", name, "missing", purpose, "pyproj sync --file us_nga_egm96_15")
    except Exception as error:  # pyproj itself is missing or broken, which its own check reports
        return Check("optional", name, "broken", f"{purpose}: {_told(error)}")
    return Check("optional", name, "ok", purpose)


def check_folder(folder: Path) -> Check:
    """Whether results can be written here, and how much fits."""
    name = "this folder"
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"crowdfence")
            file.flush()
        free_gb = shutil.disk_usage(folder).free / 1e9
    except OSError as error:
        detail = f"{folder} cannot be written to: {error.strerror or error}"
        return Check("machine", name, "broken", detail, "name another folder with -o")
    return Check("machine", name, "ok", f"{folder}, writable, {free_gb:.1f} GB free")


def check_opengl() -> Check:
    """What the simulator draws with."""
    from crowdfence.simulation.rendering.opengl_context import INSTALL_LINE, NoOpenGL, open_context

    name = "OpenGL (EGL)"
    purpose = "pictures of the simulator; labels and depth do not need it"
    try:
        context = open_context()
        renderer = str(context.info["GL_RENDERER"])
        context.release()
    except NoOpenGL as error:
        if isinstance(error.__cause__, ModuleNotFoundError):  # the package's own check says how to get it
            return Check("optional", name, "broken", f"{error.__cause__.name} is missing")
        return Check("optional", name, "missing", purpose, INSTALL_LINE)
    except Exception as error:  # drivers fail in their own ways
        return Check("optional", name, "broken", f"{purpose}: {_told(error)}", INSTALL_LINE)
    return Check("optional", name, "ok", f"{renderer}, {purpose}")


def _tried(group: Group, name: str, trial: Callable[[], str], remedy: str) -> Check:
    try:
        return Check(group, name, "ok", trial())
    except ModuleNotFoundError as error:  # the package's own check says how to get it
        return Check(group, name, "broken", f"{error.name} is missing")
    except Exception as error:  # that it fails is the finding, however it does
        return Check(group, name, "broken", _told(error), remedy)


def _core() -> str:
    """A camera 10 m above a plane looks straight down with 90 degrees: a square of 20 x 20 m, all crowd."""
    import numpy as np

    from crowdfence import _core

    terrain = _core.Terrain.from_height_map(np.zeros((40, 40)), 1.0, origin=(-20.0, -20.0, 0.0))
    camera = _core.Camera.pinhole(100, 100, 50.0, 50.0, 50.0, 50.0)
    looking_down = np.diag([1.0, -1.0, -1.0, 1.0])
    looking_down[2, 3] = 10.0
    view = _core.View("doctor", 0, camera, looking_down, np.full((10, 10), 255, dtype=np.uint8))
    started = time.perf_counter()
    observation = _core.project(view, terrain, max_range_m=100.0)
    milliseconds = (time.perf_counter() - started) * 1e3
    voxels, pixels = len(observation.voxel_ids), int(observation.pixel_count.sum())
    if voxels != 400 or pixels != 10_000 or not (observation.mean == 1.0).all():
        raise ValueError(f"a view of 400 voxels gave {voxels} voxels from {pixels} pixels")
    return f"{_core.__version__}, a view of 400 voxels projected in {milliseconds:.1f} ms"


def _proj() -> str:
    """The middle of UTM zone 32 on the equator is at 9 degrees east, by definition."""
    import pyproj

    from crowdfence.georeference import Georeference

    place = Georeference.from_projected("EPSG:32632", 500_000.0, 0.0, 0.0)
    if max(abs(place.latitude_deg), abs(place.longitude_deg - 9.0)) > 1e-9:
        raise ValueError(f"(500000, 0) of UTM zone 32 came out at {place}")
    network = "on" if pyproj.network.is_network_enabled() else "off"
    data, own = Path(pyproj.datadir.get_data_dir()), Path(pyproj.__file__).parent
    place_of_data = "its own data" if data.is_relative_to(own) else f"data in {data}"
    return f"{pyproj.proj_version_str}, {place_of_data}, network {network}"


def _gdal() -> str:
    """A GeoTIFF in memory, written and read back."""
    import numpy as np
    import rasterio
    from rasterio.io import MemoryFile

    heights = np.array([[1.0, 2.0], [3.0, 4.0]], dtype=np.float32)
    transform = rasterio.transform.from_origin(500_000.0, 2.0, 1.0, 1.0)
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=2, height=2, count=1, dtype="float32", crs="EPSG:32632", transform=transform
        ) as written:
            written.write(heights, 1)
        with memory.open() as read:
            if read.crs.to_epsg() != 32632 or not np.array_equal(read.read(1), heights):
                raise ValueError("a GeoTIFF came back changed")
    return f"{rasterio.__gdal_version__}, writes and reads GeoTIFF"


def _elsewhere(package: str, variables: str) -> str:
    return f"unset {variables} if set, or pip install --force-reinstall {package}"


def _minimum_versions() -> dict[str, str]:
    """Distribution -> lowest version that the installed crowdfence asks for; empty if it is not installed."""
    try:
        requirements = importlib.metadata.requires("crowdfence") or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    found = (re.match(r"([\w-]+)(?:\[[^]]*\])?\s*>=\s*([\d.]+)", line) for line in requirements)
    return {match[1]: match[2] for match in found if match}


def _numbers(version: str) -> tuple[int, ...]:
    """Leading numbers of a version: "2.1.0rc1" -> (2, 1, 0)."""
    release = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(int(part) for part in release[0].split(".")) if release else ()


def _memory() -> str:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        kilobytes = {line.split(":")[0]: int(line.split()[1]) for line in lines if line.endswith("kB")}
        total, available = kilobytes["MemTotal"], kilobytes["MemAvailable"]
    except (OSError, ValueError, KeyError):
        return "unknown on this system"
    return f"{total / 1e6:.1f} GB, {available / 1e6:.1f} GB available"


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(error, whole=True)}"
