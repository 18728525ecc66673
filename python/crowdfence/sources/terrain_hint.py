"""A map that lies beside a recording."""

from pathlib import Path

_PREFERRED = ("terrain.bt", "terrain.ot", "dem.tif")
_SUFFIXES = (".bt", ".ot", ".tif", ".tiff", ".laz", ".las", ".ply", ".obj")


def find_terrain(folder: Path) -> Path | None:
    """terrain/terrain.bt, .ot or terrain/dem.tif if there, else the only map file in terrain/."""
    maps = folder / "terrain"
    for name in _PREFERRED:
        if (maps / name).is_file():
            return maps / name
    candidates = [path for path in maps.glob("*") if path.suffix.lower() in _SUFFIXES and path.is_file()]
    return candidates[0] if len(candidates) == 1 else None
