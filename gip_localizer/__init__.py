# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Camera-to-road-map localization with the Gramian-weighted norm.

One frame passes the folders of `gip_localizer.core` in this order:

1. `birdseye`    camera image → mean and footprint area of every road cell
2. `gramian`     footprint areas → weight of every cell
3. `match`       map window and bird's-eye view → score of every candidate (x, y, yaw)
4. `refine`      best candidates → continuous poses with covariance
5. `integrity`, `track`  publish or withhold, filter, tracking state

`search` chooses the candidates: near a prior, or on the whole map. `core.localizer.Localizer`
is these steps as one method. Around it: `io` reads and writes messages, maps and bags without
ROS; `session` runs a localizer on a stream of messages for node and replay alike; `synthetic`
renders cameras over maps; `mapping` builds maps; `evaluation`, `paper` and `benchmark` judge;
`ros` holds the nodes and is the only folder that imports rclpy; `cli` is the desk tool `gip`.

"""

__version__ = '0.1.0'
