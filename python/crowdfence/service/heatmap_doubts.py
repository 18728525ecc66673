"""The alarm for heatmaps in the wrong units: a drone whose crowds are read as almost none clears ground."""

from __future__ import annotations

from collections import Counter

from crowdfence._core import View
from crowdfence.pipeline.heatmap_units import HeatmapUnits
from crowdfence.service.alerts import Alerts

LEAST_LOOKED_AT = 10
"""A run is judged at its end; of a drone that goes on giving views so many are looked at first."""


class HeatmapDoubts:
    """Looks at the views as they pass; what it counts begins anew with the process."""

    def __init__(self, alerts: Alerts) -> None:
        self._alerts, self._units = alerts, HeatmapUnits()
        self._looked_at: Counter[str] = Counter()
        self._doubted: dict[str, bool] = {}
        """What was told of each drone last."""

    def look(self, view: View, now_ns: int) -> None:
        """Raise the alarm for its drone, or clear it, also one from before a restart, once a heatmap holds
        more than such units can show."""
        drone = view.drone
        self._units.look(view)
        self._looked_at[drone] += 1
        if self._looked_at[drone] < LEAST_LOOKED_AT:
            return
        text = self._units.warning(drone)
        if self._doubted.get(drone) is (text is not None):
            return
        self._doubted[drone] = text is not None
        if text is None:
            self._alerts.clear("heatmap_units", now_ns, drone=drone)
        else:
            self._alerts.raise_("heatmap_units", "alarm", text, now_ns, drone=drone)
