# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A tester on the graph, for tests of nodes that run as processes of their own."""

from __future__ import annotations

import os
import time

from ros_domain import own_domain

from gip_localizer.ros.middleware import private_graph

# Before rclpy starts: a graph that no other test process, and no other machine, sees.
GRAPH = private_graph(own_domain())
os.environ.update(GRAPH)

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters  # noqa: E402
import rclpy  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

PATIENCE = 180.0  # s: a busy machine takes its time
SETTLING = 0.2  # s: a server that does not know of its client yet drops the answer
ANSWER = 15.0  # s: after it an answer counts as lost, and the question is put again


class Tester(Node):
    """Plays the camera and everyone who listens to the localizer."""

    __test__ = False

    def __init__(self):
        rclpy.init(args=[])
        super().__init__('tester')
        self.executor_ = SingleThreadedExecutor()
        self.executor_.add_node(self)
        self.poses, self.with_covariance, self.diagnostics, self.maps = [], [], [], []
        listen = self.create_subscription
        listen(PoseStamped, 'pose', self.poses.append, 10)
        listen(PoseWithCovarianceStamped, 'pose_with_covariance', self.with_covariance.append, 10)
        listen(DiagnosticArray, '/diagnostics', self.diagnostics.append, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        listen(OccupancyGrid, 'map', self.maps.append, latched)
        self.image = self.create_publisher(Image, 'image', 10)
        self.info = self.create_publisher(CameraInfo, 'camera_info', 10)
        self.odom = self.create_publisher(Odometry, 'odom', 10)
        self.initial = self.create_publisher(PoseWithCovarianceStamped, 'initialpose', 10)

    def close(self):
        self.executor_.shutdown()
        self.destroy_node()
        rclpy.try_shutdown()

    def until(self, condition, what, alive=None):
        """Spin until a condition holds; fail with `what` after a bounded time."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'waited in vain for {what}'
            if alive is not None:
                assert alive.poll() is None, f'the node ended while waiting for {what}'
            self.executor_.spin_once(timeout_sec=0.05)

    def spin(self, seconds):
        """Listen for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor_.spin_once(timeout_sec=0.01)

    def matched(self):
        publishers = (self.image, self.info, self.odom, self.initial)
        heard = all(publisher.get_subscription_count() for publisher in publishers)
        return heard and self.count_publishers('pose')

    def ask(self, kind, name, request):
        """Call a service and return its answer."""
        client = self.create_client(kind, name)
        self.until(client.service_is_ready, f'service {name}')
        self.spin(SETTLING)
        asked = [client.call_async(request)]
        last = time.monotonic()

        def answered():
            nonlocal last
            if time.monotonic() - last > ANSWER:
                asked.append(client.call_async(request))
                last = time.monotonic()
            return any(future.done() for future in asked)

        self.until(answered, f'an answer from {name}')
        self.destroy_client(client)
        return next(future.result() for future in asked if future.done())

    def set(self, name, value, node='localizer'):
        change = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[change])
        [result] = self.ask(SetParameters, f'/{node}/set_parameters', request).results
        return result

    def get(self, name, node='localizer'):
        return self.get_all([name], node)[name]

    def get_all(self, names, node='localizer'):
        """Return the values of parameters by name, from one call."""
        request = GetParameters.Request(names=names)
        values = self.ask(GetParameters, f'/{node}/get_parameters', request).values
        return {name: Parameter.from_parameter_msg(_named(name, value)).value
                for name, value in zip(names, values, strict=True)}

    def describe(self, name, node='localizer'):
        request = DescribeParameters.Request(names=[name])
        [found] = self.ask(DescribeParameters, f'/{node}/describe_parameters', request).descriptors
        return found

    def status(self, concern):
        """Return the newest diagnostic status of a concern; None before the first."""
        if not self.diagnostics:
            return None
        [found] = [s for s in self.diagnostics[-1].status if s.name.endswith(f': {concern}')]
        return found

    def said(self, concern, word):
        """Return whether the newest diagnostics of a group contain a word."""
        return bool(self.diagnostics) and word in self.status(concern).message

    def levels(self):
        """All levels that the output had so far."""
        return {
            status.level for message in self.diagnostics for status in message.status
            if status.name.endswith(': output')
        }

    def trigger(self, name):
        return self.ask(Trigger, name, Trigger.Request())

    def switch(self, name, on):
        return self.ask(SetBool, name, SetBool.Request(data=on))


def _named(name, value):
    from rcl_interfaces.msg import Parameter as Message

    return Message(name=name, value=value)
