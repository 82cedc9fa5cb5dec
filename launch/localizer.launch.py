# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The node: `ros2 launch gip_localizer localizer.launch.py map_file:=/maps/road.yaml`.

All else is optional: params_file, namespace, rviz:=true, use_sim_time:=true, lifecycle:=true,
log_level, respawn, and a name for each topic, as in image:=/front/image_raw. What is not given
here is as the parameter file has it.

"""

from pathlib import Path

from ament_index_python.packages import (
    get_package_prefix,
    get_package_share_directory,
    PackageNotFoundError,
)
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory('gip_localizer')) / 'config'
TOPICS = (
    'image', 'image/compressed', 'image/foxglove', 'mask', 'camera_info', 'odom', 'initialpose',
    'pose', 'pose_with_covariance', 'map',
)  # fmt: skip
TREES = ('tf', 'tf_static')
OF_THE_FILE = ('map_file', 'use_sim_time', 'lifecycle')
"""Parameters that are given to the node only where they are given here."""
ARGUMENTS = {
    'map_file': ('', 'map: a nav2 map_server YAML file; empty: that of params_file'),
    'params_file': (str(CONFIG / 'localizer.yaml'), 'ROS parameter file of the node'),
    'namespace': ('', 'namespace of the node and its relative topics'),
    'use_sim_time': ('', 'true: take the time from /clock; empty: as in params_file'),
    'lifecycle': ('', 'true: start as a managed node, unconfigured; empty: as in params_file'),
    'log_level': ('info', 'debug, info, warn, error or fatal'),
    'respawn': ('false', 'start the node again 2 s after it ended'),
    'rviz': ('false', 'open RViz too'),
}


def is_true(text):
    """Return a launch argument as a truth value."""
    words = {'true': True, '1': True, 'false': False, '0': False}
    if text.lower() not in words:
        raise RuntimeError(f'launch argument {text!r}: expected true or false')
    return words[text.lower()]


def check(given):
    """Refuse what cannot work before any process is started."""
    if not Path(given['params_file']).is_file():
        raise RuntimeError(f'params_file {given["params_file"]}: no such file')
    if is_true(given['rviz']):
        try:
            get_package_prefix('rviz2')
        except PackageNotFoundError:
            raise RuntimeError(
                'rviz:=true, and rviz2 is not installed: apt install ros-jazzy-rviz2, or leave '
                'rviz out'
            ) from None


def start(context):
    """Return the nodes, once all arguments are known."""
    names = (*ARGUMENTS, *TOPICS, *TREES)
    given = {name: LaunchConfiguration(name).perform(context) for name in names}
    check(given)
    over_the_file = {name: given[name] for name in OF_THE_FILE if given[name]}
    for switch in ('use_sim_time', 'lifecycle'):
        if switch in over_the_file:
            over_the_file[switch] = is_true(over_the_file[switch])
    trees = [(f'/{name}', given[name]) for name in TREES]
    nodes = [Node(
        package='gip_localizer',
        executable='localizer',
        name='localizer',
        namespace=given['namespace'],
        output='screen',
        parameters=[given['params_file'], *([over_the_file] if over_the_file else [])],
        remappings=[*((topic, given[topic]) for topic in TOPICS if given[topic] != topic), *trees],
        arguments=['--ros-args', '--log-level', given['log_level']],
        respawn=is_true(given['respawn']),
        respawn_delay=2.0,
    )]  # fmt: skip
    if is_true(given['rviz']):
        clock = {'use_sim_time': over_the_file.get('use_sim_time', False)}
        nodes.append(Node(
            package='rviz2',
            executable='rviz2',
            namespace=given['namespace'],
            # The layout names the node's topics from the root.
            remappings=[
                *((f'/{topic}', given[topic]) for topic in TOPICS),
                ('/localizer/overlay', 'localizer/overlay'), *trees,
            ],
            arguments=['-d', str(CONFIG / 'localizer.rviz')],
            parameters=[clock],
        ))  # fmt: skip
    return nodes


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    arguments += [
        DeclareLaunchArgument(topic, default_value=topic, description=f'name of the topic {topic}')
        for topic in TOPICS
    ]
    arguments += [
        DeclareLaunchArgument(tree, default_value=f'/{tree}', description=f'name of /{tree}')
        for tree in TREES
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=lambda context: start(context))])
