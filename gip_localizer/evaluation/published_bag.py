# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Write the poses of a run to MCAP, as the node publishes them, logged at image stamps.

Diagnostics hold one status with the result and the figures of each frame. Rates, delays and
topics, which the node reports too, exist only in a running system.

"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gip_localizer.evaluation.metrics import status_word
from gip_localizer.evaluation.run import FrameResult, Run
from gip_localizer.io.bags.writer import BagWriter, make, make_header, make_pose
from gip_localizer.parameters import Parameters
from gip_localizer.session.attitude import AttitudeSource

POSE, POSE_WITH_COVARIANCE, DIAGNOSTICS = '/pose', '/pose_with_covariance', '/diagnostics'
TOPICS = {
    POSE: 'geometry_msgs/msg/PoseStamped',
    POSE_WITH_COVARIANCE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
    DIAGNOSTICS: 'diagnostic_msgs/msg/DiagnosticArray',
}
OK, ERROR = 0, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def write_published(path: Path, run: Run) -> None:
    """
    Write one MCAP file.

    Timings are left out, so that the same run gives the same bytes.

    Parameters
    ----------
    path : Path
        File to write, e.g. `published.mcap`.
    run : Run
        Its estimates are written in order.

    """
    folder = path.with_suffix('')
    with BagWriter(folder, TOPICS) as bag:
        for estimate in run.estimates:
            _write_frame(bag, estimate, run.parameters)
    (folder / path.name).replace(path)
    (folder / 'metadata.yaml').unlink()
    folder.rmdir()


def _write_frame(bag: BagWriter, estimate: FrameResult, parameters: Parameters) -> None:
    stamp = estimate.stamp_ns
    log_ns = max(stamp, 0)  # a bag cannot hold times before 1970, which a wrong clock gives
    bag.write(DIAGNOSTICS, log_ns, _diagnostics(estimate))
    if estimate.pose is None:
        return
    header, pose = make_header(stamp, parameters.frames.map), make_pose(estimate.pose)
    bag.write(POSE, log_ns, make('geometry_msgs/msg/PoseStamped', header=header, pose=pose))
    if estimate.covariance is None:
        return
    with_covariance = make(
        'geometry_msgs/msg/PoseWithCovariance', pose=pose,
        covariance=AttitudeSource(parameters.attitude).covariance(estimate.covariance),
    )
    bag.write(POSE_WITH_COVARIANCE, log_ns, make(
        'geometry_msgs/msg/PoseWithCovarianceStamped', header=header, pose=with_covariance,
    ))


def _diagnostics(estimate: FrameResult) -> Any:
    word = status_word(estimate)
    values = [
        make('diagnostic_msgs/msg/KeyValue', key=key, value=f'{value:.9g}')
        for key, value in estimate.quality.items()
    ]
    status = make(
        'diagnostic_msgs/msg/DiagnosticStatus',
        level=OK if estimate.pose is not None else ERROR,
        name='localizer: localization', hardware_id='localizer',
        message=f'{word}: {estimate.reason}'.rstrip(': '), values=values,
    )
    return make(
        'diagnostic_msgs/msg/DiagnosticArray',
        header=make_header(estimate.stamp_ns, ''), status=[status],
    )
