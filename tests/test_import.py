"""What `import crowdfence` costs and offers."""

import json
import subprocess
import sys

import pytest

import crowdfence

# The public surface. A name that leaves this list breaks somebody's code.
PUBLIC_NAMES = [
    "Camera",
    "ClearAir",
    "Client",
    "Contract",
    "CrowdColumns",
    "CrowdMap",
    "CrowdMass",
    "CrowdfenceError",
    "Detector",
    "DetectorError",
    "Evidence",
    "EvidenceConfig",
    "FrameError",
    "FrameLoop",
    "Georeference",
    "GroupingConfig",
    "LikelihoodRatio",
    "LinearPool",
    "LogOdds",
    "LogPool",
    "MapFileError",
    "MovingAverage",
    "Observation",
    "Or",
    "OrConfig",
    "Paper",
    "PaperConfig",
    "ProjectionConfig",
    "Rates",
    "Recording",
    "Run",
    "RunConfig",
    "StampError",
    "Step",
    "SurfaceGrid",
    "Terrain",
    "Update",
    "View",
    "ViewError",
    "VoxelKnowledge",
    "VoxelState",
    "Zone",
    "ZoneConfig",
    "ZoneEngine",
    "ZoneHistory",
    "ZoneSet",
    "__version__",
    "blend",
    "detector_rates",
    "find_zones",
    "landing_prior",
    "mean_iou",
    "open_recording",
    "open_static_zones",
    "open_terrain",
    "pool",
    "project",
    "run",
    "safe_route",
    "safety_distance_m",
    "write_geojson",
    "write_geotiff",
    "write_results",
]


def _modules_after(statement: str) -> set[str]:
    """Top-level modules outside the standard library that a fresh interpreter loads for a statement."""
    script = (
        f"import sys, json; before = set(sys.modules); {statement}; "
        "print(json.dumps(sorted(set(sys.modules) - before)))"
    )
    finished = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    top_level = {name.partition(".")[0] for name in json.loads(finished.stdout)}
    return {name for name in top_level - set(sys.stdlib_module_names) if not name.startswith("_")}


def test_import_needs_numpy_at_most() -> None:
    assert {"crowdfence"} <= _modules_after("import crowdfence") <= {"crowdfence", "numpy"}


def test_the_core_works_with_numpy_only() -> None:
    use = (
        "import numpy, crowdfence as c; t = c.Terrain.from_occupancy(numpy.ones((2, 2, 1), bool), 1.0); "
        "m = c.CrowdMap(t, c.Paper(c.Rates(0.9, 0.1), 0.2, fleet_size=1)); "
        "v = c.View('a', 0, c.Camera.pinhole(4, 4, 4, 4, 2, 2), numpy.diag([1.0, -1, -1, 1]), "
        "numpy.ones((4, 4), numpy.uint8)); m.integrate([v], 0); m.state(0); m.to_bytes()"
    )
    assert _modules_after(use) == {"crowdfence", *_modules_after("import numpy")}


def test_the_public_surface_is_the_one_listed() -> None:
    assert sorted(crowdfence.__all__) == PUBLIC_NAMES
    assert dir(crowdfence) == PUBLIC_NAMES


@pytest.mark.parametrize("name", PUBLIC_NAMES)
def test_every_public_name_can_be_imported(name: str) -> None:
    namespace: dict[str, object] = {}
    exec(f"from crowdfence import {name}", namespace)
    assert namespace[name] is getattr(crowdfence, name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'crowdfence' has no attribute 'Crowdmap'"):
        crowdfence.Crowdmap  # noqa: B018


CORE_CLASSES = [
    "Camera",
    "CrowdColumns",
    "CrowdMap",
    "CrowdMass",
    "LinearPool",
    "LogOdds",
    "LogPool",
    "MovingAverage",
    "Observation",
    "Or",
    "Paper",
    "Rates",
    "Terrain",
    "Update",
    "View",
]
CORE_EXCEPTIONS = ["CrowdfenceError", "MapFileError", "StampError", "ViewError"]


@pytest.mark.parametrize("name", CORE_CLASSES + CORE_EXCEPTIONS)
def test_classes_of_the_core_are_named_as_they_are_imported(name: str) -> None:
    core_class = getattr(crowdfence, name)
    assert (core_class.__module__, core_class.__qualname__) == ("crowdfence", name)
