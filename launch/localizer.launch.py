# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The node: `ros2 launch gip_localizer localizer.launch.py map_file:=/maps/road.yaml`.

All else is optional: params_file, namespace, rviz:=true, use_sim_time:=true, lifecycle:=true, and
a name for each topic, as in image:=/front/image_raw.

"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CONFIG = Path(get_package_share_directory('gip_localizer')) / 'config'
TOPICS = (
    'image', 'image/compressed', 'mask', 'camera_info', 'odom', 'initialpose', 'pose',
    'pose_with_covariance', 'map',
)  # fmt: skip
ARGUMENTS = {
    'params_file': (str(CONFIG / 'localizer.yaml'), 'ROS parameter file of the node'),
    'namespace': ('', 'namespace of the node and its relative topics'),
    'use_sim_time': ('false', 'take the time from /clock'),
    'lifecycle': ('false', 'start as a managed node, unconfigured'),
    'rviz': ('false', 'open RViz too'),
}


def generate_launch_description():
    arguments = [DeclareLaunchArgument('map_file', description='map: a nav2 map_server YAML file')]
    arguments += [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    arguments += [
        DeclareLaunchArgument(topic, default_value=topic, description=f'name of the topic {topic}')
        for topic in TOPICS
    ]
    switches = {
        name: ParameterValue(LaunchConfiguration(name), value_type=bool)
        for name in ('use_sim_time', 'lifecycle')
    }
    map_file = ParameterValue(LaunchConfiguration('map_file'), value_type=str)
    localizer = Node(
        package='gip_localizer',
        executable='localizer',
        name='localizer',
        namespace=LaunchConfiguration('namespace'),
        output='screen',
        parameters=[
            LaunchConfiguration('params_file'),
            {'map_file': map_file, **switches},
        ],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in TOPICS],
    )
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        namespace=LaunchConfiguration('namespace'),
        # The layout names the node's topics from the root.
        remappings=[
            *((f'/{topic}', LaunchConfiguration(topic)) for topic in TOPICS),
            ('/localizer/overlay', 'localizer/overlay'),
        ],
        arguments=['-d', str(CONFIG / 'localizer.rviz')],
        parameters=[{'use_sim_time': switches['use_sim_time']}],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
    return LaunchDescription([*arguments, localizer, rviz])
