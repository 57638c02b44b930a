"""What the viewers' map, 3D and log panels open by themselves: Foxglove's schemas, in protobuf.

| topic | schema | made from | when |
|---|---|---|---|
| `/map/truth` | foxglove.LocationFix | the plant's `north east` | at 5 Hz |
| `/map/gps` | foxglove.LocationFix | the sensors' `gps_fix gps_north gps_east` | every fix |
| `/map/estimate` | foxglove.LocationFix | the estimator's `north east` | at 5 Hz |
| `/3d/frames` | foxglove.FrameTransforms | `map` (axes east, north, up) to `dog`, `estimate` | at 5 Hz |
| `/3d/scene` | foxglove.SceneUpdate | waypoints, their capture circles, an arrow for each frame | once |
| `/log/events` | foxglove.Log | commands, waypoints reached, anomalies, outcome | as they happen |

A topic is there only if the signals that it is made from are. Times are trial time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
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
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from harness.log.geodesy import TangentPlane
from models.cmec import Anomaly
from models.commands import Command, Status

SECOND = 1_000_000_000  # ns
PERIOD = SECOND // 5  # ns: a dog moves two metres in it at most
CIRCLE_POINTS = 48

GREEN, ORANGE = Color(r=0.0, g=0.62, b=0.45, a=1.0), Color(r=0.90, g=0.62, b=0.0, a=1.0)
MAGENTA, YELLOW = Color(r=0.80, g=0.20, b=0.60, a=1.0), Color(r=0.94, g=0.78, b=0.10, a=1.0)

Row = Sequence[float]


class Message(Protocol):
    """A protobuf message."""

    def SerializeToString(self) -> bytes: ...  # noqa: N802


@dataclass(frozen=True)
class Route:
    """The mission: places as (label, north, east) in m, home last, and the capture radius in m."""

    places: tuple[tuple[str, float, float], ...]
    radius: float

    @classmethod
    def of(cls, parameters: Mapping[str, str]) -> Route | None:
        """From a log's `parameters` record; None if its controller has no such waypoints."""
        try:

            def value(name: str) -> float:
                return float(parameters[f"controller.{name}"])

            numbers = range(1, int(value("waypoint_count")) + 1)
            places = [
                (f"waypoint {i}", value(f"waypoint_north[{i}]"), value(f"waypoint_east[{i}]"))
                for i in numbers
            ]
            home = ("home", value("home_north"), value("home_east"))
            return cls((*places, home), value("capture_radius"))
        except (KeyError, ValueError):
            return None


class _Topic:
    """One topic of protobuf messages, written at trial times in ns."""

    def __init__(self, writer: Writer, topic: str, schema: Any) -> None:
        self.writer = writer
        number = writer.register_schema(
            schema.DESCRIPTOR.full_name,
            SchemaEncoding.Protobuf,
            build_file_descriptor_set(schema).SerializeToString(),
        )
        self.channel = writer.register_channel(topic, MessageEncoding.Protobuf, number)

    def write(self, time: int, message: Message) -> None:
        self.writer.add_message(self.channel, time, message.SerializeToString(), time)


class _Fixes:
    """A track on the map; `columns` are those of north, east and, for GPS, of the accuracy h_acc."""

    def __init__(self, topic: _Topic, component: str, columns: Sequence[int], plane: TangentPlane) -> None:
        self.topic, self.component, self.columns, self.plane = topic, component, columns, plane
        self.message = LocationFix(frame_id="map")

    def write(self, time: int, rows: Mapping[str, Row]) -> None:
        row = rows[self.component]
        north, east, *h_acc = (row[column] for column in self.columns)
        if not (math.isfinite(north) and math.isfinite(east)):
            return  # a map cannot show it; the component's own topic has it
        message = self.message
        message.timestamp.seconds, message.timestamp.nanos = divmod(time, SECOND)
        latitude, longitude = self.plane.from_plane(north, east)
        message.latitude, message.longitude = math.degrees(latitude), math.degrees(longitude)
        if h_acc:
            variance = (h_acc[0] / 2) ** 2  # eq. 3.15 in m
            message.position_covariance[:] = [variance, 0, 0, 0, variance, 0, 0, 0, 0]
            message.position_covariance_type = LocationFix.APPROXIMATED
        self.topic.write(time, message)


class _Frames:
    """Where the dog is, and where the estimator thinks it is, for the 3D panel."""

    def __init__(self, topic: _Topic, tracks: Mapping[str, tuple[str, Sequence[int]]]) -> None:
        self.topic, self.message = topic, FrameTransforms()
        self.tracks = [
            (component, columns, self.message.transforms.add(parent_frame_id="map", child_frame_id=frame))
            for frame, (component, columns) in tracks.items()
        ]

    def write(self, time: int, rows: Mapping[str, Row]) -> None:
        seconds, nanoseconds = divmod(time, SECOND)
        for component, columns, transform in self.tracks:
            row = rows[component]
            _place(transform, *(row[column] for column in columns))
            transform.timestamp.seconds, transform.timestamp.nanos = seconds, nanoseconds
        self.topic.write(time, self.message)


def _place(transform: FrameTransform, north: float, east: float, heading: float) -> None:
    """A heading is clockwise from north, a rotation counterclockwise from east."""
    half = (math.pi / 2 - heading) / 2 if math.isfinite(heading) else 0.0
    transform.translation.x, transform.translation.y = east, north
    transform.rotation.z, transform.rotation.w = math.sin(half), math.cos(half)


class _Events:
    """Changes of the controller's outputs, told in words."""

    LEVELS = {Status.FAILED: Event.ERROR, Status.STOPPED: Event.WARNING}

    def __init__(self, topic: _Topic, columns: Mapping[str, int]) -> None:
        self.topic, self.columns = topic, columns
        self.before: tuple[float, ...] = ()

    def write(self, time: int, rows: Mapping[str, Row]) -> None:
        row = rows["controller"]
        now = tuple(row[column] for column in self.columns.values())
        # An anomaly is an event on every tick that reports one; everything else is one when it changes.
        if now != self.before or now[-1]:
            before = dict(zip(self.columns, self.before or (0,) * len(now), strict=True))
            for name, value in zip(self.columns, now, strict=True):
                if value != before[name] or (name == "anomaly" and value):
                    self.tell(time, name, value)
            self.before = now

    def tell(self, time: int, name: str, value: float) -> None:
        level: Event.Level.ValueType = Event.INFO
        match name:
            case "command":
                text = f"command {named(Command, value)}"
            case "status":
                text = f"trial {named(Status, value)}"
                level = self.LEVELS.get(Status(int(value)), level) if value in set(Status) else level
            case "waypoint" if value:
                text = f"waypoint {value:g} reached"
            case "anomaly" if value:
                text, level = f"anomaly {named(Anomaly, value)}", Event.WARNING
            case _:  # back to none
                return
        message = Event(level=level, message=text, name="controller")
        message.timestamp.seconds, message.timestamp.nanos = divmod(time, SECOND)
        self.topic.write(time, message)


def named(names: type[Anomaly] | type[Command] | type[Status], value: float) -> str:
    """The name of an enumeration's value, or the number that a foreign component gave instead."""
    return names(int(value)).name if value in set(names) else f"{value:g}"


class Views:
    """The topics above, for what a log's components provide.

    `signals` are the names of each component's signals in the order of its rows, `origin` the latitude and
    longitude of north = east = 0 in degrees, `route` the waypoints.
    """

    def __init__(
        self,
        writer: Writer,
        signals: Mapping[str, Sequence[str]],
        origin: tuple[float, float],
        route: Route | None,
    ) -> None:
        plane = TangentPlane(*map(math.radians, origin))
        columns = {role: {name: i for i, name in enumerate(names)} for role, names in signals.items()}

        def find(role: str, *names: str) -> list[int]:
            held = columns.get(role, {})
            return [held[name] for name in names] if held.keys() >= set(names) else []

        self.regular: list[_Fixes | _Frames] = []
        frames: dict[str, tuple[str, Sequence[int]]] = {}
        for topic, role, frame in (("truth", "plant", "dog"), ("estimate", "estimator", "estimate")):
            if position := find(role, "north", "east"):
                fixes = _Fixes(_Topic(writer, f"/map/{topic}", LocationFix), role, position, plane)
                self.regular.append(fixes)
            if pose := find(role, "north", "east", "heading"):
                frames[frame] = (role, pose)
        if frames:
            self.regular.append(_Frames(_Topic(writer, "/3d/frames", FrameTransforms), frames))
        self.scene = _Topic(writer, "/3d/scene", SceneUpdate) if frames or route else None
        self.entities = [_arrow(frame) for frame in frames] + (_circles(route) if route else [])

        self.gps: _Fixes | None = None
        if position := find("sensors", "gps_north", "gps_east"):
            accuracy = find("sensors", "gps_h_acc")
            self.gps = _Fixes(_Topic(writer, "/map/gps", LocationFix), "sensors", position + accuracy, plane)
        self.fix = find("sensors", "gps_fix")

        names = [n for n in ("status", "command", "waypoint", "anomaly") if find("controller", n)]
        self.events: _Events | None = None
        if names:
            by_name = {name: columns["controller"][name] for name in names}
            self.events = _Events(_Topic(writer, "/log/events", Event), by_name)
        self.due = 0

    def write(self, time: int, rows: Mapping[str, Row]) -> None:
        """Write what is due at `time` (ns) for one tick's rows."""
        if self.scene:
            self.scene.write(time, SceneUpdate(entities=self.entities))
            self.scene = None
        if time >= self.due:
            self.due = (time // PERIOD + 1) * PERIOD
            for view in self.regular:
                view.write(time, rows)
        if self.gps and self.fix and rows["sensors"][self.fix[0]]:
            self.gps.write(time, rows)
        if self.events:
            self.events.write(time, rows)


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


def _pose(north: float, east: float) -> Pose:
    return Pose(position=Vector3(x=east, y=north), orientation=Quaternion(w=1.0))
