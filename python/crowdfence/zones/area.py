"""Areas that others draw: of one whose outline crosses itself nobody knows what is inside. GEOS answers all
the same, and where it makes such an area larger, it loses parts of it."""

from __future__ import annotations

from crowdfence.errors import quoted


def require_area(shape: object, name: str) -> None:
    """TypeError for what is no polygon, ValueError where its outline crosses itself."""
    import shapely

    if not isinstance(shape, (shapely.Polygon, shapely.MultiPolygon)):
        raise TypeError(f"{name} is {quoted(shape)}; it must be a Polygon or MultiPolygon of shapely")
    if not shape.is_valid:
        raise ValueError(f"{name} is no area: {shapely.is_valid_reason(shape)}")
