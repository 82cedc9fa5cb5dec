# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes; nothing outside this folder imports rclpy."""
