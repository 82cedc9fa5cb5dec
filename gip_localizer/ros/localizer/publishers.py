# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything the node `localizer` publishes."""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Vector3Stamped
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Bool, Float64

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.protection import PROTECTION
from gip_localizer.ros.conversions import (
    bgr8,
    header_of,
    mono8,
    occupancy_grid,
    pose_stamped,
    pose_with_covariance,
)
from gip_localizer.ros.endpoints import advertise
from gip_localizer.session.attitude import AttitudeSource
from gip_localizer.session.frontend import Frontend
from gip_localizer.visualization.match_images import birdseye_picture, comparison_picture
from gip_localizer.visualization.overlay import camera_overlay

FIGURES = {'~/quality': 'confidence', '~/score': 'correlation'}
"""Topic → figure of an estimate (no unit, in [0, 1]) that it carries."""


class Outputs:
    """
    The publishers of a node.

    Parameters
    ----------
    node : Node
        Publishes.
    frame, base : str
        The map's frame, in which poses are given, and the vehicle's, for protection levels.
    raster_map : RasterMap
        Published once, transient local.

    """

    def __init__(self, node: Node, frame: str, base: str, raster_map: RasterMap) -> None:
        self._node = node
        self._frame, self._base = frame, base
        self._raster_map = raster_map
        reliable = QoSProfile(depth=10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        posed = PoseWithCovarianceStamped
        self._pose = advertise(node, PoseStamped, 'pose', reliable)
        self._with_covariance = advertise(node, posed, 'pose_with_covariance', reliable)
        self._last_pose = advertise(node, posed, '~/last_pose', latched)
        self._figures = {topic: advertise(node, Float64, topic, reliable) for topic in FIGURES}
        self._protection = advertise(node, Vector3Stamped, '~/protection_level', reliable)
        self._valid = advertise(node, Bool, '~/protection_valid', reliable)
        self._execution = advertise(node, Float64, '~/execution_time_ms', reliable)
        self._birdseye = advertise(node, Image, '~/birdseye', qos_profile_sensor_data)
        self._comparison = advertise(node, Image, '~/comparison', qos_profile_sensor_data)
        self._overlay = advertise(node, Image, '~/overlay', qos_profile_sensor_data)
        self._map = advertise(node, OccupancyGrid, 'map', latched)
        self.publish_map(raster_map)

    def publish_map(self, raster_map: RasterMap) -> None:
        """Publish a map (transient local), and use it for the images from now on."""
        self._raster_map = raster_map
        self._map.publish(occupancy_grid(self._now_ns(), self._frame, raster_map))

    def publish(self, estimate: Estimate, elapsed_ms: float, attitude: AttitudeSource) -> None:
        """Publish the pose of an estimate, if it has one, and the figures of the frame."""
        if estimate.pose is not None and estimate.covariance is not None:
            posed = pose_stamped(
                estimate.stamp_ns, self._frame, estimate.pose, attitude.tilt
            )
            self._pose.publish(posed)
            certain = pose_with_covariance(posed, attitude.covariance(estimate.covariance))
            self._with_covariance.publish(certain)
            self._last_pose.publish(certain)
            self._publish_protection(estimate)
        self._execution.publish(Float64(data=elapsed_ms))
        for topic, name in FIGURES.items():
            if name in estimate.quality:
                self._figures[topic].publish(Float64(data=float(estimate.quality[name])))

    def _publish_protection(self, estimate: Estimate) -> None:
        """Publish the protection level of a pose: ahead, left (m), heading (rad) as x, y, z."""
        level = Vector3Stamped(header=header_of(estimate.stamp_ns, self._base))
        level.vector.x, level.vector.y, level.vector.z = (
            float(estimate.quality[name]) for name in PROTECTION
        )
        self._protection.publish(level)
        self._valid.publish(Bool(data=bool(estimate.quality['protection_valid'])))

    def publish_pictures(self, estimate: Estimate, frame: str, frontend: Frontend) -> None:
        """
        Publish images of the match, if they have subscribers.

        Parameters
        ----------
        estimate : Estimate
            Of the frame.
        frame : str
            Frame of the vehicle, for the images from above.
        frontend : Frontend
            Contains the image of the frame.

        """
        if self._overlay.get_subscription_count() and frontend.image is not None:
            overlay = camera_overlay(frontend.image, frontend.camera, self._raster_map, estimate)
            self._overlay.publish(bgr8(estimate.stamp_ns, frontend.camera_frame, overlay))
        match = estimate.match
        if match is None:
            return
        if self._birdseye.get_subscription_count():
            picture = birdseye_picture(match.view)
            self._birdseye.publish(mono8(estimate.stamp_ns, frame, picture))
        pose = estimate.pose or (match.fit.pose if match.fit is not None else None)
        if pose is not None and self._comparison.get_subscription_count():
            picture = comparison_picture(self._raster_map, match.view, pose)
            self._comparison.publish(bgr8(estimate.stamp_ns, frame, picture))

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
