# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Step 5: the state of a drive: pose filter, odometry, tracking state, time order."""
