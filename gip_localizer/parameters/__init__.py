# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable once: the localizer's parameters, and the groups that tie it into a stack."""

from gip_localizer.parameters.localizer import (
    Birdseye,
    Camera,
    CameraMotion,
    dump_parameter_file,
    Integrity,
    load_parameter_file,
    METRICS,
    Motion,
    Parameters,
    Recovery,
    Score,
    Search,
)

__all__ = [
    'METRICS', 'Birdseye', 'Camera', 'CameraMotion', 'Integrity', 'Motion', 'Parameters',
    'Recovery', 'Score', 'Search', 'dump_parameter_file', 'load_parameter_file',
]
