# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node alone: `ros2 launch gip_localizer localizer.launch.py map_file:=/maps/road.yaml`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(get_package_share_directory('gip_localizer'))
TOPICS = ('image', 'camera_info', 'odom', 'initialpose', 'pose', 'pose_with_covariance', 'map')


def generate_launch_description():
    parameters = DeclareLaunchArgument(
        'params_file', default_value=str(SHARE / 'config' / 'localizer.yaml'),
        description='ROS parameter file of the node',
    )
    map_file = DeclareLaunchArgument('map_file', description='map: a nav2 map_server YAML file')
    topics = [
        DeclareLaunchArgument(topic, default_value=topic, description=f'name of the topic {topic}')
        for topic in TOPICS
    ]
    localizer = Node(
        package='gip_localizer',
        executable='localizer',
        name='localizer',
        output='screen',
        parameters=[
            LaunchConfiguration('params_file'), {'map_file': LaunchConfiguration('map_file')},
        ],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in TOPICS],
    )
    return LaunchDescription([parameters, map_file, *topics, localizer])
