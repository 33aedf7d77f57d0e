"""Scans, detections of radars and machines as messages of ASAM OSI 3.

World: swath's ENU as it is. Vehicle frame of OSI: ISO 8855, origin in the middle of the rear axle, which in a
combine is the steered one; swath's is below the middle of the front axle. Angles as in swath: z-y'-x''.

Detections: positions are spherical in the sensor's frame, as in swath. A radial velocity of OSI is positive
towards the sensor, swath's away from it.
"""

import importlib
from collections.abc import Mapping
from dataclasses import fields
from math import isnan
from typing import Any

import numpy as np

from swath.core.errors import MissingExtra
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.machine.machine_sheet import MachineSheet, dynamics_of
from swath.signals import MachineState, Scan
from swath.signals.radar import RadarTargets

Sample = Scan | RadarTargets


def sensor_view(view: Any, sample: Sample) -> Any:
    """A new LidarSensorView or RadarSensorView in a SensorView; its configuration, still to be placed."""
    if isinstance(sample, RadarTargets):
        return view.radar_sensor_view.add().view_configuration
    rays = view.lidar_sensor_view.add().view_configuration
    rays.field_of_view_horizontal = float(np.ptp(sample.azimuth))
    rays.field_of_view_vertical = float(np.ptp(sample.elevation))
    rays.max_number_of_interactions = sample.ranges.shape[1]
    cos = np.cos(sample.elevation)
    ways = (cos * np.cos(sample.azimuth), cos * np.sin(sample.azimuth), np.sin(sample.elevation))
    for x, y, z in zip(*(axis.tolist() for axis in ways), strict=True):
        rays.directions.add(x=x, y=y, z=z)
    return rays


def add_detections(features: Any, sample: Sample) -> Any:
    """The detections of a sample into a FeatureData; their header, still to be filled."""
    if isinstance(sample, RadarTargets):
        found = features.radar_sensor.add()
        _radar(found, sample)
    else:
        found = features.lidar_sensor.add()
        _lidar(found, sample)
    found.header.number_of_valid_detections = len(found.detection)
    return found.header


def _lidar(sensor: Any, scan: Scan) -> None:
    """One for each echo."""
    beams, echoes = np.nonzero(np.isfinite(scan.ranges))
    per_echo = (scan.ranges[beams, echoes], scan.intensity[beams, echoes])
    columns = (beams, scan.azimuth[beams], scan.elevation[beams], *per_echo)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for beam, azimuth, elevation, distance, intensity in rows:
        found = sensor.detection.add(existence_probability=1.0)
        found.position.distance, found.position.azimuth = distance, azimuth
        found.position.elevation = elevation
        if not isnan(intensity):
            found.intensity = 100.0 * intensity
        if hasattr(found, "beam_id"):
            found.beam_id.value = beam


def _radar(sensor: Any, seen: RadarTargets) -> None:
    """One for each; what the radar does not know stays away, an elevation that it does not measure is 0."""
    names = [f.name for f in fields(seen) if f.name != "t"]
    for row in zip(*(getattr(seen, name).tolist() for name in names), strict=True):
        distance, azimuth, elevation, speed, rcs, snr, distance_sd, azimuth_sd, speed_sd = row
        found = sensor.detection.add()
        found.position.distance, found.position.azimuth = distance, azimuth
        found.position.elevation = 0.0 if isnan(elevation) else elevation
        found.radial_velocity, found.rcs = -speed, rcs
        for target, name, value in (
            (found, "snr", snr),
            (found.position_rmse, "distance", distance_sd),
            (found.position_rmse, "azimuth", azimuth_sd),
            (found, "radial_velocity_rmse", speed_sd),
        ):
            if not isnan(value):
                setattr(target, name, value)


TYPES = {"sd": "SensorData", "sv": "SensorView"}
SENSOR_ID = 1


def load_osi() -> dict[str, Any]:
    """The modules of osi-python that are used here, by short names. MissingExtra."""
    names = {n: f"osi3.osi_{n}_pb2" for n in ("object", "sensordata", "sensorview", "version")}
    try:
        return {name: importlib.import_module(module) for name, module in names.items()}
    except ImportError as error:
        raise MissingExtra("osi", "an OSI trace") from error


class Writer:
    """Makes the messages of one scanner or radar.

    host: name of the machine that carries it
    sheets: of all machines, in their order
    mounting: pose_machine_sensor
    """

    def __init__(self, host: str, sheets: Mapping[str, MachineSheet], mounting: Pose) -> None:
        self._osi = load_osi()
        self._host, self._sheets = host, dict(sheets)
        self._ids = {name: k + 1 for k, name in enumerate(self._sheets)}
        self._rear = {name: _rear_axle(sheet) for name, sheet in self._sheets.items()}
        self._mounting = Pose(mounting.position - self._rear[host], mounting.rotation)
        options = self._osi["version"].DESCRIPTOR.GetOptions()
        self._version = next(v for f, v in options.ListFields() if f.name == "current_interface_version")

    @property
    def version(self) -> tuple[int, int, int]:
        """Version of the interface."""
        v = self._version
        return v.version_major, v.version_minor, v.version_patch

    def sensor_view(self, sample: Sample, states: Mapping[str, MachineState]) -> Any:
        """Truth at the end of a sweep or look: where the machines are, and the rays of a scanner.

        There are no reflections in it: the rays within a beam, and a radar's, are not recorded.
        """
        view = self._osi["sensorview"].SensorView()
        self._head(view, sample.t)
        view.host_vehicle_id.value = self._ids[self._host]
        _mount(view.mounting_position, self._mounting)
        truth = view.global_ground_truth
        truth.version.CopyFrom(self._version)
        _time(truth.timestamp, sample.t)
        truth.host_vehicle_id.value = self._ids[self._host]
        for name, state in states.items():
            self._machine(truth.moving_object.add(), name, state)
        looks = sensor_view(view, sample)
        looks.sensor_id.value = SENSOR_ID
        _mount(looks.mounting_position, self._mounting)
        return view

    def sensor_data(self, sample: Sample, states: Mapping[str, MachineState]) -> Any:
        """The detections in the sensor's frame, and the view they came from."""
        data = self._osi["sensordata"].SensorData()
        self._head(data, sample.t)
        _time(data.last_measurement_time, sample.t)
        _mount(data.mounting_position, self._mounting)
        data.sensor_view.add().CopyFrom(self.sensor_view(sample, states))
        head = add_detections(data.feature_data, sample)
        _time(head.measurement_time, sample.t)
        _mount(head.mounting_position, self._mounting)
        head.sensor_id.value = SENSOR_ID
        head.data_qualifier = head.DATA_QUALIFIER_AVAILABLE
        return data

    def _head(self, message: Any, t: int) -> None:
        message.version.CopyFrom(self._version)
        _time(message.timestamp, t)
        message.sensor_id.value = SENSOR_ID

    def _machine(self, found: Any, name: str, state: MachineState) -> None:
        """A machine as the box of its chassis; the header is not in it."""
        sheet = self._sheets[name]
        rear, front, half, _, top = sheet.body
        centre = np.array([0.5 * (rear + front), 0.0, 0.5 * top])
        found.id.value = self._ids[name]
        found.type = self._osi["object"].MovingObject.TYPE_VEHICLE
        base, pose = found.base, state.pose
        base.dimension.length, base.dimension.width, base.dimension.height = front - rear, 2.0 * half, top
        _vector(base.position, pose.apply(centre))
        _angles(base.orientation, pose)
        turn = np.array([0.0, 0.0, state.yaw_rate])
        along = np.array([state.speed, state.lateral_speed, 0.0]) + np.cross(turn, centre)
        _vector(base.velocity, pose.turn(along))
        base.orientation_rate.yaw = state.yaw_rate
        axle = np.array([0.0, 0.0, dynamics_of(sheet).front.radius])
        _vector(found.vehicle_attributes.bbcenter_to_rear, self._rear[name] - centre)
        _vector(found.vehicle_attributes.bbcenter_to_front, axle - centre)


def _rear_axle(sheet: MachineSheet) -> Any:
    """Middle of the rear axle in swath's machine frame [m]."""
    return np.array([-sheet.wheelbase, 0.0, dynamics_of(sheet).rear.radius])


def _time(stamp: Any, t: int) -> None:
    stamp.seconds, stamp.nanos = divmod(t, NS)


def _vector(target: Any, value: Any) -> None:
    target.x, target.y, target.z = (float(v) for v in value)


def _angles(target: Any, pose: Pose) -> None:
    target.roll, target.pitch, target.yaw = pose.euler()


def _mount(target: Any, pose: Pose) -> None:
    _vector(target.position, pose.position)
    _angles(target.orientation, pose)
