# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Camera-to-road-map localization with the Gramian-weighted norm.

The data flow, in the order of the modules of `gip_localizer.core`:

1. `birdseye`    camera image → mean and footprint area of every road cell
2. `gramian`     footprint areas → weight of every cell
3. `matching`    map window and bird's-eye view → score of every candidate (x, y, yaw)
4. `posterior`   scores and prior → pose, covariance, quality, status

`core.localizer.Localizer.update` is these four steps as one method. `io` reads and writes
messages, maps and bags without ROS; `synthetic` renders cameras over maps; `evaluation` judges;
`ros` holds the nodes and is the only folder that imports rclpy; `cli` is the desk tool `gip`.

"""

__version__ = '0.1.0'
