"""Pictures and heatmaps of ROS on their way into the service.

Each drone has a thread and a room of its own: one whose poses are late keeps nobody else waiting."""

from __future__ import annotations

import base64
import logging
import queue
from threading import Event, Thread
from typing import Any

from crowdfence._core import Camera
from crowdfence.service.alerts import Alerts
from crowdfence.service.clock import Clock
from crowdfence.service.gate import Refused
from crowdfence.service.live import Live
from crowdfence.service.ros.intrinsics import Intrinsics
from crowdfence.service.ros.poses import RosPoses
from crowdfence.service.ros.topics import ROLES
from crowdfence.service.view_message import CameraMessage, HeatmapMessage, ViewMessage
from crowdfence.sources.mission import ros2_messages
from crowdfence.sources.mission.camera_info import camera_from_info, rectified_camera
from crowdfence.sources.ros_bag.picture import encoded_picture, heatmap_pixels

_LOG = logging.getLogger(__name__)
_ROOM = 16
"""Pictures of a drone that wait for their poses, or for the camera_info that says what they are of."""
_LISTEN_S = 0.2
_INFO_WITHIN_S = 2.0


class Intake:
    """Messages of one drone. `take` may be called from any thread."""

    def __init__(
        self,
        drone: str,
        live: Live,
        alerts: Alerts,
        clock: Clock,
        poses: RosPoses | None,
        *,
        rectified: bool = False,
    ) -> None:
        """`poses`: the feed that its pose topics fill; None: its poses come from elsewhere. `rectified`: so
        are its pictures, and its CameraInfo is that of the raw ones."""
        self._drone, self._live, self._alerts, self._clock = drone, live, alerts, clock
        self._poses = poses
        self._camera_of = rectified_camera if rectified else camera_from_info
        self._intrinsics = Intrinsics(_INFO_WITHIN_S)
        self._frame_of_info = ""
        """For pictures that name no frame, as in bags."""
        self._waiting: queue.Queue[tuple[str, str, bytes]] = queue.Queue(_ROOM)
        self._stopping = Event()
        self._thread = Thread(target=self._give_all, name=f"ros {drone}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()

    def take(self, role: str, kind: str, data: bytes, *, fixed: bool = False) -> None:
        """A message as it came; what it is good for decides its role."""
        if kind not in ROLES[role]:
            self._refuse(f"a message of {self._drone} is {kind}; {role} needs {' or '.join(ROLES[role])}")
            return
        try:
            if role in ("camera", "heatmap"):
                self._waiting.put_nowait((role, kind, data))
            elif role == "info":
                info = ros2_messages.decode(kind, data)
                self._frame_of_info = info.header.frame_id.lstrip("/")
                self._intrinsics.heard(ros2_messages.time_ns(info.header.stamp), self._camera(info))
            elif self._poses is not None:
                message = ros2_messages.decode(kind, data)
                if role == "origin":
                    self._poses.placed(message)
                elif role == "tf":
                    self._poses.transformed(message, fixed=fixed)
                else:
                    self._poses.posed(message)
        except queue.Full:
            self._refuse(
                f"{_ROOM} pictures of {self._drone} wait for their poses or camera_info; newer ones are left "
                "out"
            )
        except (ValueError, KeyError) as error:
            self._refuse(f"a message of {self._drone} ({role}, {kind}) cannot be used: {error}")

    def _camera(self, info: Any) -> Camera | str:
        """Why it is none, for the pictures that it is of: an earlier one is not theirs."""
        try:
            return self._camera_of(info)
        except ValueError as error:
            return f"its camera_info cannot be used: {error}"

    def _give_all(self) -> None:
        while not self._stopping.is_set():
            try:
                role, kind, data = self._waiting.get(timeout=_LISTEN_S)
            except queue.Empty:
                continue
            try:
                self._live.intake.give_view(self._view(role, kind, data))
            except Refused as error:
                self._told(f"a view of {self._drone} was not taken: {error.reason}")
            except (ValueError, KeyError) as error:
                self._refuse(f"a message of {self._drone} ({role}, {kind}) cannot be used: {error}")
            except Exception as error:  # a disk that fails for a moment must not end all its pictures
                _LOG.exception("a message of %s could not be given", self._drone)
                self._refuse(f"a message of {self._drone} ({role}, {kind}) was not taken: {error}")

    def _view(self, role: str, kind: str, data: bytes) -> bytes:
        message: Any = ros2_messages.decode(kind, data)
        stamp_ns = ros2_messages.time_ns(message.header.stamp)
        camera = self._intrinsics.at(stamp_ns)
        if self._poses is not None:
            self._poses.camera_frame = message.header.frame_id.lstrip("/") or self._frame_of_info
        view = ViewMessage(
            drone=self._drone,
            stamp_ns=stamp_ns,
            camera=CameraMessage.of(camera),
        )
        if role == "heatmap":
            view.heatmap = HeatmapMessage.of(heatmap_pixels(message))
        else:
            picture = encoded_picture(message, packed=kind == ros2_messages.COMPRESSED_IMAGE)
            view.image = base64.b64encode(picture).decode("ascii")
        return view.model_dump_json().encode()

    def _refuse(self, reason: str) -> None:
        self._live.heard.refused[self._drone] += 1
        self._told(reason)

    def _told(self, reason: str) -> None:
        _LOG.warning("view refused: %s", reason, extra={"drone": self._drone})
        self._alerts.raise_("refused_views", "warning", reason, self._clock.now_ns(), drone=self._drone)
