"""What the viewers' map, 3D and log panels open by themselves: Foxglove's schemas, in protobuf.

| topic | schema | made from | when |
|---|---|---|---|
| `/map/truth` | foxglove.LocationFix | the plant's `north east` | at 5 Hz |
| `/map/gps` | foxglove.LocationFix | the sensors' `gps_fix gps_north gps_east`, as they arrived | every fix |
| `/map/estimate` | foxglove.LocationFix | the estimator's `north east` | at 5 Hz |
| `/3d/frames` | foxglove.FrameTransforms | `map` (axes east, north, up) to `dog`, `estimate` | at 5 Hz |
| `/3d/scene` | foxglove.SceneUpdate | waypoints, fence, streets, poles, an arrow for each frame | once |
| `/log/events` | foxglove.Log | commands, waypoints reached, anomalies, outcome | as they happen |

A topic is there only if the signals that it is made from are. Times are trial time.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log as Event
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap_protobuf.schema import build_file_descriptor_set

from harness.log.channel import SECOND, Array
from harness.log.container import Container
from harness.log.events import OUTPUTS, in_words
from harness.log.geodesy import TangentPlane
from harness.log.ground import Ground
from harness.log.route import Route
from models.commands import Status

PERIOD = SECOND // 5  # ns: a dog moves two metres in it at most
CIRCLE_POINTS = 48
POLE = Vector3(x=0.2, y=0.2, z=1.5)  # m
BELOW = -0.05  # m: streets lie under what is drawn on the ground

GREEN, ORANGE = Color(r=0.0, g=0.62, b=0.45, a=1.0), Color(r=0.90, g=0.62, b=0.0, a=1.0)
MAGENTA, YELLOW = Color(r=0.80, g=0.20, b=0.60, a=1.0), Color(r=0.94, g=0.78, b=0.10, a=1.0)
RED = Color(r=0.80, g=0.15, b=0.10, a=1.0)
GREY, BROWN = Color(r=0.60, g=0.64, b=0.68, a=1.0), Color(r=0.48, g=0.29, b=0.0, a=1.0)

Times = npt.NDArray[np.int64]
Ticks = npt.NDArray[np.intp]  # (n,) rows of a batch
Moments = Sequence[tuple[int, bytes]]  # log time in ns; the same as a Timestamp, its length before it
Message = tuple[int, int, bytes]  # channel, log time in ns, protobuf


def _topic(container: Container, topic: str, schema: Any) -> int:
    """Add a topic of protobuf messages; its channel."""
    descriptors = build_file_descriptor_set(schema).SerializeToString()
    number = container.add_schema(schema.DESCRIPTOR.full_name, SchemaEncoding.Protobuf, descriptors)
    return container.add_channel(topic, MessageEncoding.Protobuf, number)


# Thousands of positions a second are laid out here: protobuf would set each field of each message by a call.
# A field begins with a byte: 8 times its number, and 1 for a double or 2 for what has a length..
_PLACE = struct.Struct("<BdBd")  # LocationFix: latitude, longitude
_POSE = struct.Struct("<BBBdBdBBBdBd")  # FrameTransform: translation x, y; rotation z, w
_HALF_POSE = 18  # bytes of either
_FIX_TIME, _FRAME_TIME, _TRANSFORM = b"\x32", b"\x0a", b"\x0a"


class _Fixes:
    """A track on the map; `columns` are those of north, east and, for GPS, of the accuracy h_acc."""

    def __init__(self, channel: int, component: str, columns: Sequence[int], plane: TangentPlane) -> None:
        self.channel, self.component, self.columns, self.plane = channel, component, columns, plane
        self.rest = LocationFix(frame_id="map").SerializeToString()  # without time and place
        self.h_acc = math.nan  # m, what the covariance is made from

    def encode(self, moments: Moments, values: Mapping[str, Array], ticks: Ticks) -> list[Message]:
        """A fix for each tick, save where it has no finite position, which a map cannot show."""
        rows = values[self.component][ticks].take(self.columns, axis=1).tolist()
        messages = []
        for (time, stamp), (north, east, *h_acc) in zip(moments, rows, strict=True):
            if math.isfinite(north) and math.isfinite(east):
                if h_acc and h_acc[0] != self.h_acc:
                    self._state_accuracy(h_acc[0])
                latitude, longitude = self.plane.place(north, east)
                place = _PLACE.pack(0x09, latitude, 0x11, longitude)
                messages.append((self.channel, time, place + _FIX_TIME + stamp + self.rest))
        return messages

    def _state_accuracy(self, h_acc: float) -> None:
        self.h_acc = h_acc
        variance = (h_acc / 2) ** 2  # eq. 3.15 in m
        self.rest = LocationFix(
            frame_id="map",
            position_covariance=[variance, 0, 0, 0, variance, 0, 0, 0, 0],
            position_covariance_type=LocationFix.APPROXIMATED,
        ).SerializeToString()


class _Frames:
    """Where the dog is, and where the estimator thinks it is, for the 3D panel."""

    def __init__(self, channel: int, tracks: Mapping[str, tuple[str, Sequence[int]]]) -> None:
        self.channel = channel
        self.tracks = list(tracks.values())
        self.names = [
            FrameTransform(parent_frame_id="map", child_frame_id=frame).SerializeToString()
            for frame in tracks
        ]

    def encode(self, moments: Moments, values: Mapping[str, Array], ticks: Ticks) -> list[Message]:
        """All frames for each tick."""
        poses = [
            values[component][ticks].take(columns, axis=1).tolist() for component, columns in self.tracks
        ]
        messages = []
        for (time, stamp), of_frames in zip(moments, zip(*poses, strict=True), strict=True):
            message = b""
            for (north, east, heading), names in zip(of_frames, self.names, strict=True):
                # a heading is clockwise from north, a rotation counterclockwise from east
                half = (math.pi / 2 - heading) / 2 if math.isfinite(heading) else 0.0
                pose = _POSE.pack(
                    0x22, _HALF_POSE, 0x09, east, 0x11, north,
                    0x2A, _HALF_POSE, 0x19, math.sin(half), 0x21, math.cos(half),
                )  # fmt: skip
                transform = _FRAME_TIME + stamp + names + pose
                message += _TRANSFORM + bytes([len(transform)]) + transform
            messages.append((self.channel, time, message))
        return messages


class _Events:
    """Changes of the controller's outputs in words; `columns` by name, the anomaly's last."""

    LEVELS = {Status.FAILED: Event.ERROR, Status.STOPPED: Event.WARNING}

    def __init__(self, channel: int, columns: Mapping[str, int]) -> None:
        self.channel, self.names, self.columns = channel, list(columns), list(columns.values())
        self.before = np.zeros((1, len(columns)))

    def encode(self, times: Times, values: Mapping[str, Array]) -> list[Message]:
        """An event for each change, and for the anomaly on every tick that reports one."""
        now = values["controller"].take(self.columns, axis=1)
        if self.names[-1] == "anomaly" and not now[:, -1].any() and (now == self.before).all():
            return []
        rows = np.concatenate([self.before, now])
        self.before = rows[-1:]
        happens = rows[1:] != rows[:-1]
        if self.names[-1] == "anomaly":
            happens[:, -1] |= rows[1:, -1] != 0
        events: list[Message] = []
        for tick, column in np.argwhere(happens).tolist():
            if event := _event(self.names[column], float(rows[tick + 1, column])):
                time = int(times[tick])
                event.timestamp.seconds, event.timestamp.nanos = divmod(time, SECOND)
                events.append((self.channel, time, event.SerializeToString()))
        return events


def _event(name: str, value: float) -> Event | None:
    """What the new value of an output means; None if it only returns to none."""
    text = in_words(name, value)
    if not text:
        return None
    level: Event.Level.ValueType = Event.WARNING if name == "anomaly" else Event.INFO
    if name == "status" and value in set(Status):
        level = _Events.LEVELS.get(Status(int(value)), level)
    return Event(level=level, message=text, name="controller")


class Views:
    """The topics above, for what a log's components provide.

    `signals` are the names of each component's signals in the order of its rows, `origin` the latitude and
    longitude of north = east = 0 in degrees, `route` the waypoints, `receiver` whose GPS fixes there are,
    `ground` the streets and poles of a simulated dog.
    """

    def __init__(
        self,
        container: Container,
        signals: Mapping[str, Sequence[str]],
        origin: tuple[float, float],
        route: Route | None,
        *,
        receiver: str = "sensors",
        ground: Ground | None = None,
    ) -> None:
        plane = TangentPlane(*map(math.radians, origin))
        columns = {role: {name: i for i, name in enumerate(names)} for role, names in signals.items()}

        def find(role: str, *names: str) -> list[int]:
            places = columns.get(role, {})
            return [places[name] for name in names] if places.keys() >= set(names) else []

        self.regular: list[_Fixes | _Frames] = []
        frames: dict[str, tuple[str, Sequence[int]]] = {}
        for topic, role, frame in (("truth", "plant", "dog"), ("estimate", "estimator", "estimate")):
            if position := find(role, "north", "east"):
                channel = _topic(container, f"/map/{topic}", LocationFix)
                self.regular.append(_Fixes(channel, role, position, plane))
            if pose := find(role, "north", "east", "heading"):
                frames[frame] = (role, pose)
        if frames:
            self.regular.append(_Frames(_topic(container, "/3d/frames", FrameTransforms), frames))
        self.scene = _topic(container, "/3d/scene", SceneUpdate) if frames or route else None
        self._scene = self.scene
        self._constant = [_arrow(frame) for frame in frames] + (_world(ground) if ground else [])
        self.drawing = _drawing(self._constant, route)

        self.gps: _Fixes | None = None
        if position := find(receiver, "gps_north", "gps_east"):
            channel = _topic(container, "/map/gps", LocationFix)
            self.gps = _Fixes(channel, receiver, position + find(receiver, "gps_h_acc"), plane)
        self.fix = find(receiver, "gps_fix")

        names = [n for n in OUTPUTS if find("controller", n)]
        self.events: _Events | None = None
        if names:
            by_name = {name: columns["controller"][name] for name in names}
            self.events = _Events(_topic(container, "/log/events", Event), by_name)
        self.period = np.array([-1])  # the last one that had a tick

    def settle(self, origin: tuple[float, float], route: Route | None) -> None:
        """Origin and waypoints are known now, or others: the scene is drawn anew with the next tick."""
        plane = TangentPlane(*map(math.radians, origin))
        for view in (*self.regular, self.gps):
            if isinstance(view, _Fixes):
                view.plane = plane
        self.scene = self._scene
        self.drawing = _drawing(self._constant, route)

    def encode(self, times: Times, values: Mapping[str, Array]) -> list[Message]:
        """What is due in a batch of ticks.

        Args:
            times: (n,) in ns, growing.
            values: by component (n, signals).
        """
        messages: list[Message] = []
        if self.scene is not None:
            messages.append((self.scene, int(times[0]), self.drawing))
            self.scene = None
        periods = np.concatenate([self.period, times // PERIOD])
        self.period = periods[-1:]
        due = np.flatnonzero(periods[1:] > periods[:-1])
        if len(due):
            moments = _moments(times[due])
            for view in self.regular:
                messages += view.encode(moments, values, due)
        if self.gps and self.fix:
            fixes = np.flatnonzero(values[self.gps.component][:, self.fix[0]])
            messages += self.gps.encode(_moments(times[fixes]), values, fixes)
        if self.events:
            messages += self.events.encode(times, values)
        return messages


def _moments(times: Times) -> Moments:
    moments = []
    for time in times.tolist():
        stamp = Timestamp(seconds=time // SECOND, nanos=time % SECOND).SerializeToString()
        moments.append((time, bytes([len(stamp)]) + stamp))
    return moments


def _arrow(frame: str) -> SceneEntity:
    """An arrow a metre long that moves with its frame: green the dog, orange the estimate."""
    arrow = ArrowPrimitive(
        pose=_pose(0, 0),
        shaft_length=0.7,
        shaft_diameter=0.3,
        head_length=0.5,
        head_diameter=0.6,
        color=GREEN if frame == "dog" else ORANGE,
    )
    return SceneEntity(id=frame, frame_id=frame, frame_locked=True, arrows=[arrow])


def _drawing(constant: list[SceneEntity], route: Route | None) -> bytes:
    """The scene: what stays whatever the mission is, waypoints, fence."""
    entities = constant + (_circles(route) + _fence(route) if route else [])
    data: bytes = SceneUpdate(entities=entities).SerializeToString()
    return data


def _world(ground: Ground) -> list[SceneEntity]:
    """The world of a simulated dog, which nothing on board knows: streets as flat pieces, and poles."""
    streets = [
        SceneEntity(id=f"street {i} of the simulated dog", frame_id="map", triangles=[_piece(outline)])
        for i, outline in enumerate(ground.outlines(), start=1)
    ]
    poles = [
        SceneEntity(
            id=f"pole {i} of the simulated dog",
            frame_id="map",
            cylinders=[
                CylinderPrimitive(
                    pose=_pose(north, east, POLE.z / 2), size=POLE, bottom_scale=1, top_scale=1, color=BROWN
                )
            ],
        )
        for i, (north, east) in enumerate(ground.poles, start=1)
    ]
    return streets + poles


def _piece(outline: Sequence[tuple[float, float]]) -> TriangleListPrimitive:
    """What a convex outline encloses, as a fan of triangles."""
    corners = range(1, len(outline) - 1)
    return TriangleListPrimitive(
        pose=_pose(0, 0, BELOW),
        points=[Point3(x=east, y=north) for north, east in outline],
        color=GREY,
        indices=[corner for i in corners for corner in (0, i + 1, i)],  # counterclockwise from above
    )


def _circles(route: Route) -> list[SceneEntity]:
    """Each waypoint and home with its name and its capture circle."""
    entities = []
    for label, north, east in route.places:
        angles = (2 * math.pi * i / CIRCLE_POINTS for i in range(CIRCLE_POINTS))
        points = [Point3(x=route.radius * math.cos(a), y=route.radius * math.sin(a)) for a in angles]
        circle = LinePrimitive(
            type=LinePrimitive.LINE_LOOP,
            pose=_pose(north, east),
            thickness=0.15,
            points=points,
            color=YELLOW,
        )
        text = TextPrimitive(
            pose=_pose(north, east), billboard=True, font_size=1.5, color=MAGENTA, text=label
        )
        entities.append(SceneEntity(id=label, frame_id="map", lines=[circle], texts=[text]))
    return entities


def _fence(route: Route) -> list[SceneEntity]:
    """The polygon, if the mission has one."""
    if not route.fence:
        return []
    line = LinePrimitive(
        type=LinePrimitive.LINE_LOOP,
        pose=_pose(0, 0),
        thickness=0.3,
        points=[Point3(x=east, y=north) for north, east in route.fence],
        color=RED,
    )
    return [SceneEntity(id="fence", frame_id="map", lines=[line])]


def _pose(north: float, east: float, up: float = 0.0) -> Pose:
    return Pose(position=Vector3(x=east, y=north, z=up), orientation=Quaternion(w=1.0))
