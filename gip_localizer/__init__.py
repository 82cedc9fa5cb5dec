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

The names below are the public Python interface (docs/api.md). They are imported when they are
first used, so that `import gip_localizer` stays quick.

"""

from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from gip_localizer.api import (
        Camera,
        draw_overlay,
        Estimate,
        GipError,
        load_map,
        Localizer,
        Pose2,
    )

__version__ = '0.1.0'
__all__ = ['Camera', 'Estimate', 'GipError', 'Localizer', 'Pose2', 'draw_overlay', 'load_map']


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from gip_localizer import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
