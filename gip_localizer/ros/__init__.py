# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The nodes; the only folder that imports rclpy."""

from gip_localizer.core.threads import use_one_library_thread

use_one_library_thread()
