# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The map that a node localizes on, and its change while the node runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
from rclpy.node import Node
from rclpy.parameter import Parameter

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import MapError, ParameterError
from gip_localizer.io.map_files import load_map
from gip_localizer.io.map_yaml import map_settings
from gip_localizer.parameters import Parameters
from gip_localizer.parameters.yaml_files import user_path
from gip_localizer.ros.conversions import occupancy_grid
from gip_localizer.session.pose_file import map_hash

try:
    from nav2_msgs.srv import LoadMap
except ImportError:  # of the same fields, and in every installation of ROS
    from nav_msgs.srv import LoadMap

SERVICE = '~/load_map'


class MapInUse:
    """
    The map of `map_file`.

    Parameters
    ----------
    parameters : Parameters
        At the start.

    Attributes
    ----------
    raster_map : RasterMap
        The map that was taken last.

    Raises
    ------
    GipError
        The map cannot be read, or none is named.

    """

    def __init__(self, parameters: Parameters) -> None:
        self.raster_map = _map_of(parameters)
        self._file = parameters.map_file
        self._next: RasterMap | None = None

    def check(self, parameters: Parameters) -> None:
        """Read another map before the one in use is given up (raises GipError)."""
        self._next = None
        if parameters.map_file != self._file:
            self._next = _map_of(parameters)

    def change(self, parameters: Parameters) -> bool:
        """Take the map that `check` has read; return whether it is another one."""
        if parameters.map_file == self._file:
            return False
        self.raster_map = self._next or _map_of(parameters)
        self._file, self._next = parameters.map_file, None
        return True

    def figures(self) -> dict[str, str]:
        """Return what the diagnostics say of the map."""
        rows, cols = self.raster_map.grey.shape
        return {
            'map_cells': f'{cols} x {rows}',
            'map_resolution': f'{self.raster_map.resolution:g}',
            'map_hash': map_hash(self.raster_map),
        }


class MapService:
    """
    Serves `~/load_map`, as nav2's map server does: the parameter `map_file` by another name.

    Parameters
    ----------
    node : Node
        Serves, and holds the parameter.
    frame : str
        Frame of the map.
    current : callable
        Returns the map that was taken last.

    """

    def __init__(self, node: Node, frame: str, current: Callable[[], RasterMap]) -> None:
        self._node, self._frame, self._current = node, frame, current
        node.create_service(LoadMap, SERVICE, self._on_request)
        package = LoadMap.__module__.split('.')[0]
        if package != 'nav2_msgs':
            node.get_logger().info(
                f'{SERVICE} is of {package}/srv/LoadMap: nav2_msgs is not installed'
            )

    def _on_request(self, request: Any, response: Any) -> Any:
        try:
            path = map_path(request.map_url)
        except MapError as error:
            return self._refused(response, LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST, str(error))
        [result] = self._node.set_parameters([Parameter('map_file', value=str(path))])
        if not result.successful:
            return self._refused(response, _reason(path), result.reason)
        now = int(self._node.get_clock().now().nanoseconds)
        response.map = occupancy_grid(now, self._frame, self._current())
        response.result = LoadMap.Response.RESULT_SUCCESS
        return response

    def _refused(self, response: Any, result: int, reason: str) -> Any:
        """Answer with the number that the service has for a reason, and log the reason."""
        self._node.get_logger().error(f'{SERVICE}: {reason}')
        response.result = result
        return response


def map_path(url: str) -> Path:
    """
    Return the file that a URL names: a path, file:///PATH or package://PACKAGE/PATH.

    Raises
    ------
    MapError
        There is no such file or package, or the URL is of another kind.

    """
    parts = urlsplit(url)
    if parts.scheme == 'package':
        try:
            path = Path(get_package_share_directory(parts.netloc)) / unquote(parts.path[1:])
        except (PackageNotFoundError, ValueError, OSError):
            raise MapError(f'map {url}: no package {parts.netloc!r} is installed; expected '
                           'package://PACKAGE/PATH') from None
    elif parts.scheme == 'file':
        path = Path(unquote(parts.path))
    elif parts.scheme == '':
        path = user_path(url)
    else:
        raise MapError(f'map {url}: expected a path, file:///PATH or package://PACKAGE/PATH')
    if not path.is_file():
        raise MapError(f'map {path}: there is no such file; expected a nav2 map YAML')
    return path


def _reason(path: Path) -> int:
    """Return the result of the service for a map that cannot be loaded."""
    try:
        map_settings(path)
    except MapError:
        return int(LoadMap.Response.RESULT_INVALID_MAP_METADATA)
    return int(LoadMap.Response.RESULT_INVALID_MAP_DATA)


def _map_of(parameters: Parameters) -> RasterMap:
    if not parameters.map_file:
        raise ParameterError(
            'parameter map_file: is empty, expected the path of a nav2 map YAML; '
            'start with: --ros-args -p map_file:=/path/to/map.yaml'
        )
    return load_map(parameters.map_file)
