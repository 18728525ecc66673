"""PX4's ULog (.ulg) through pyulog (extra `ulog`).

Positions are those of the estimator (vehicle_global_position), heights above the sea and, where logged, the
ellipsoid; the camera's attitude is that of a gimbal that reports itself (gimbal_device_attitude_status).
Time 0 is the beginning of the log; the time of day comes from the satellites.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import one_line
from crowdfence.sources.film.flight_log import FlightLog
from crowdfence.sources.film.gimbal_turns import gimbal_turns, one_gimbal
from crowdfence.sources.film.merged_rows import Turns, merged
from crowdfence.sources.geographic_track import HeightsAbove
from crowdfence.sources.stamp_unit import THIS_CENTURY_S

_GIMBAL = "gimbal_device_attitude_status"
_NO_GEOID_M = 0.01
"""Closer the sea is hardly anywhere to the ellipsoid: heights so alike are one number, told twice."""
_TOPICS = [
    "vehicle_global_position",
    "vehicle_attitude",
    _GIMBAL,
    "vehicle_gps_position",
    "sensor_gps",
    "home_position",
]


def read_ulog(path: Path) -> FlightLog:
    """ValueError when the file is no ULog, is damaged beyond use, or has no positions."""
    from pyulog import ULog

    with path.open("rb") as file:
        if file.read(4) != b"ULog":
            raise ValueError(f"{path} is no ULog: it does not begin like one")
    said = io.StringIO()  # the library prints what it finds damaged
    try:
        with contextlib.redirect_stdout(said):
            log = ULog(str(path), message_name_filter_list=_TOPICS)
        topics = {data.name: data.data for data in reversed(log.data_list)}
        gimbals = {data.multi_id: data.data for data in log.data_list if data.name == _GIMBAL}
        zero_us = int(log.start_timestamp)
    except Exception as error:  # whatever the library meets in a damaged file
        raise ValueError(f"{path} is damaged: {one_line(error)}") from error
    try:
        found = _flight_log(topics, gimbals, zero_us)
    except KeyError as error:
        raise ValueError(f"{path} holds no {error.args[0]}") from error
    if "corrupt" in said.getvalue():
        found.remarks.append(f"{path.name} is damaged; what is intact of it is used")
    return found


def _flight_log(
    topics: dict[str, dict[str, Any]], gimbals: dict[int, dict[str, Any]], zero_us: int
) -> FlightLog:
    def time_s(topic: dict[str, Any]) -> NDArray[np.float64]:
        return (topic["timestamp"].astype(np.int64) - zero_us) / 1e6

    place = topics["vehicle_global_position"]
    remarks = list[str]()
    position = {
        "time_s": time_s(place),
        "latitude": np.where(_valid(place, remarks), place["lat"], np.nan),
        "longitude": place["lon"],
        "sea": place["alt"],
    }
    heights: dict[HeightsAbove, str] = {"sea": "sea"}
    ellipsoid = np.asarray(place.get("alt_ellipsoid", []), np.float64)
    if ellipsoid.size and np.isfinite(ellipsoid).all() and np.any(ellipsoid != 0):
        position["ellipsoid"] = ellipsoid
        heights["ellipsoid"] = "ellipsoid"
        if np.abs(ellipsoid - place["alt"]).max() < _NO_GEOID_M:
            remarks.append(
                "its heights above the sea and above the ellipsoid are the same, and those lie up to 107 m "
                "apart: its receiver does not tell the second, or is a simulator's; say --heights sea unless "
                "the map counts as the log does"
            )
    attitude = topics.get("vehicle_attitude")
    body = None if attitude is None else Turns.of(time_s(attitude), _quaternions(attitude))
    gimbal = _of_one_gimbal(gimbals, remarks)
    camera = None
    if gimbal is not None:
        turns = _quaternions(gimbal)
        flags = gimbal.get("device_flags", np.zeros(len(turns)))
        camera = gimbal_turns(time_s(gimbal), turns, flags, body, remarks)
    home = topics.get("home_position")
    take_off = None if home is None else (float(home["lat"][-1]), float(home["lon"][-1]))
    return merged(
        position,
        heights,
        body,
        camera,
        start_ns=_start_ns(topics, zero_us),
        take_off=take_off,
        remarks=remarks,
    )


def _of_one_gimbal(gimbals: dict[int, dict[str, Any]], remarks: list[str]) -> dict[str, Any] | None:
    """The rows of one gimbal: several may tell in instances of the topic, or in turn in one of them."""
    rows: dict[tuple[int, int], NDArray[np.bool_]] = {}
    for instance, topic in gimbals.items():
        devices = np.asarray(topic.get("gimbal_device_id", np.zeros(len(topic["timestamp"]))), np.int64)
        rows |= {(instance, int(device)): devices == device for device in np.unique(devices)}
    if not rows:
        return None
    counts = {gimbal: int(np.count_nonzero(of_it)) for gimbal, of_it in rows.items()}
    taken = one_gimbal(counts, "instance", remarks)
    return {name: values[rows[taken]] for name, values in gimbals[taken[0]].items()}


def _valid(place: dict[str, Any], remarks: list[str]) -> NDArray[np.bool_]:
    """Rows whose position the estimator itself believes in; logs before PX4 1.16 do not say."""
    count = len(place["lat"])
    valid = np.ones(count, np.bool_)
    for name in ("lat_lon_valid", "alt_valid"):
        valid &= np.asarray(place.get(name, valid), np.bool_)
    if out := int(np.count_nonzero(~valid)):
        remarks.append(f"{out} of {count} positions are left out: the log calls them not valid")
    adrift = np.asarray(place.get("dead_reckoning", ~valid), np.bool_) & valid
    if adrift.any():
        remarks.append(
            f"{adrift.sum()} of {count} positions are by dead reckoning, without satellites: they drift, and "
            "what was seen then may be put elsewhere"
        )
    return valid


def _quaternions(topic: dict[str, Any]) -> NDArray[np.float64]:
    return np.stack([np.asarray(topic[f"q[{axis}]"], np.float64) for axis in range(4)], axis=1)


def _start_ns(topics: dict[str, dict[str, Any]], zero_us: int) -> int | None:
    for name in ("vehicle_gps_position", "sensor_gps"):
        gps = topics.get(name, {})
        utc_us = np.asarray(gps.get("time_utc_usec", []), np.int64)
        # Until satellites tell it, a receiver says 0, or counts from 1970.
        utc_s = utc_us // 1_000_000
        known = (utc_s >= THIS_CENTURY_S.start) & (utc_s < THIS_CENTURY_S.stop)
        if known.any():
            apart_us = utc_us[known] - gps["timestamp"][known].astype(np.int64)
            return (int(np.median(apart_us)) + zero_us) * 1000
    return None
