# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A synthetic camera and the node, to look at in RViz.

`gip simulate clear --out /tmp/clear` makes a map to drive over; then
`ros2 launch gip_localizer demo.launch.py map_file:=/tmp/clear/map.yaml`. Set the start with
RViz's "2D Pose Estimate", or let the node find itself:
`ros2 service call /localizer/relocalize std_srvs/srv/Trigger`.

"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory('gip_localizer'))


def generate_launch_description():
    map_file = DeclareLaunchArgument('map_file', description='map: a nav2 map_server YAML file')
    world = DeclareLaunchArgument('world', default_value='road', description='world to render')
    rate = DeclareLaunchArgument('rate', default_value='10.0', description='images per second')
    large_images = [
        SetEnvironmentVariable(name, str(SHARE / 'config' / 'fastdds.xml'))
        # Fast DDS 2 (Jazzy) reads the first, Fast DDS 3 (Kilted) the second.
        for name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
    ]
    camera = Node(
        package='gip_localizer',
        executable='synthetic_camera',
        name='synthetic_camera',
        output='screen',
        parameters=[{
            'world.name': ParameterValue(LaunchConfiguration('world'), value_type=str),
            'rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
            'publish.wait': True,
        }],
    )  # fmt: skip
    localizer = Node(
        package='gip_localizer',
        executable='localizer',
        name='localizer',
        output='screen',
        parameters=[{
            'map_file': ParameterValue(LaunchConfiguration('map_file'), value_type=str),
        }],
    )
    return LaunchDescription([map_file, world, rate, *large_images, camera, localizer])
