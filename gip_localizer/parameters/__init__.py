# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable once: the localizer's parameters, and the groups that tie it into a stack."""

from gip_localizer.parameters.localizer import (
    dump_parameter_file,
    load_parameter_file,
    Parameters,
)
from gip_localizer.parameters.matching import (
    Birdseye,
    Camera,
    CameraMotion,
    Integrity,
    METRICS,
    Motion,
    Recovery,
    Score,
    Search,
)

__all__ = [
    'METRICS', 'Birdseye', 'Camera', 'CameraMotion', 'Integrity', 'Motion', 'Parameters',
    'Recovery', 'Score', 'Search', 'dump_parameter_file', 'load_parameter_file',
]
