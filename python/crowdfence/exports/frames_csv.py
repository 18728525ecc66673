"""What happened at every instant, one CSV row each."""

import csv
from collections.abc import Iterable
from dataclasses import dataclass, fields
from os import PathLike

from crowdfence.atomic_file import atomic_path
from crowdfence.iso_time import iso_utc
from crowdfence.legible import table_cell


@dataclass(frozen=True, slots=True)
class FrameRow:
    """One integrated instant."""

    stamp_ns: int
    drones: tuple[str, ...]
    """Drones whose view was integrated."""
    frames_refused: int
    """Views of this instant that were refused; the run's log says why."""
    voxels_seen: int
    """Voxels seen at this instant by any drone."""
    voxels_seen_so_far: int
    """Voxels seen at this instant or any earlier one."""
    crowd_voxels: int
    """Voxels at or above the threshold."""
    crowd_area_m2: float
    """Ground area of the columns that hold them, in zones or too small for one."""
    zones: int
    zones_area_m2: float
    """Ground area of the columns that zones of crowd were made of: also of those that are held below the
    threshold, without safety distances, unseen ground and zones of others."""
    iou: float | None = None
    """Intersection over union with the truth (equation 4), where there is truth."""
    crowd_out_of_range: float | None = None
    """Share of the crowd in the heatmaps that met ground beyond the range. Here and below: see `CrowdMass`;
    None where no heatmap shows crowd."""
    crowd_hole: float | None = None
    """That went through a hole of the map."""
    crowd_off_map: float | None = None
    """That lies beside the map."""
    crowd_sky: float | None = None
    """That lies above the horizon."""
    crowd_unusable: float | None = None
    """That is in pixels without a ray."""


def write_frames_csv(path: str | PathLike[str], rows: Iterable[FrameRow]) -> None:
    """Write RFC 4180 text: a header line, then one line per row, in the order given.

    The columns are those of `FrameRow`, with `stamp_utc` after `stamp_ns`; drones are separated by spaces and
    what is None is an empty field. Numbers keep every digit. Raises OSError when the file cannot be written.
    """
    names = [field.name for field in fields(FrameRow)]
    with atomic_path(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([names[0], "stamp_utc", *names[1:]])
        for row in rows:
            values = [getattr(row, name) for name in names[1:]]
            writer.writerow([row.stamp_ns, iso_utc(row.stamp_ns), *map(_cell, values)])


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, tuple):
        return table_cell(" ".join(value))
    return repr(float(value)) if isinstance(value, float) else str(value)
