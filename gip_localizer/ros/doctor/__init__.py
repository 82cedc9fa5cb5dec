# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The checks of `gip doctor`: of this machine, of a short loop over DDS, of a running stack.

A module that is imported before rclpy is known to be there imports nothing that may be missing.

"""
