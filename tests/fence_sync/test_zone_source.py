"""Zones of a place, of others beside them, and a margin around all of them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import Geod

from crowdfence.fence_sync import ItemCapacity, ZoneFile, ZoneSource
from crowdfence.fence_sync.placement import placed
from support.fence_zones import written_zones


@pytest.mark.parametrize("spread_deg", [0.001, 0.4])
def test_a_margin_is_closed_around_all_zones(tmp_path: Path, spread_deg: float) -> None:
    """30 m in every direction by the geodesics of PROJ, and at most a tenth more."""
    boxes = [(8.0, 47.0, 8.0004, 47.0004)]
    others = written_zones(
        tmp_path / "others.geojson", (8.0 + spread_deg, 47.0, 8.0004 + spread_deg, 47.0004)
    )
    source = ZoneSource(ZoneFile(written_zones(tmp_path / "zones.geojson", *boxes)), [others], margin_m=30.0)
    found = source.read()
    sent = placed(found.zones, found.georeference, ItemCapacity(400)).shapes
    closed = shapely.MultiPolygon(
        [
            shapely.Polygon([(item.longitude_e7 / 1e7, item.latitude_e7 / 1e7) for item in shape])
            for shape in sent
        ]
    )

    def within(distance_m: float) -> shapely.Geometry:
        """Of both boxes: what lies between the places so far from their corners in all directions."""
        hulls = []
        for west in (8.0, 8.0 + spread_deg):
            corners = shapely.get_coordinates(shapely.box(west, 47.0, west + 0.0004, 47.0004))
            away_deg = np.tile(np.arange(0.0, 360.0, 2.5), len(corners))
            east, north = np.repeat(corners, len(away_deg) // len(corners), axis=0).T
            places = Geod(ellps="WGS84").fwd(east, north, away_deg, np.full(len(east), distance_m))[:2]
            hulls.append(shapely.MultiPoint(np.column_stack(places)).convex_hull)
        return shapely.union_all(hulls)

    assert closed.covers(within(29.99)) and within(33.0).covers(closed)


def test_files_of_others_that_could_not_be_read_are_read_once_they_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing was written since, and yet there are zones that nobody took up."""
    others = written_zones(tmp_path / "others.geojson", (8.002, 47.0, 8.003, 47.001))
    own = written_zones(tmp_path / "zones.geojson", (8.0, 47.0, 8.001, 47.001))
    source = ZoneSource(ZoneFile(own), [others])

    def denied(path: Path, *, read: Callable[[Path], bytes] = Path.read_bytes) -> bytes:
        if path == others:
            raise OSError("denied")
        return read(path)

    with monkeypatch.context() as broken, pytest.raises(OSError, match="denied"):
        broken.setattr(Path, "read_bytes", denied)
        source.read()
    assert source.has_changed() and len(source.read().zones) == 2 and not source.has_changed()
