# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The localizer itself: NumPy, SciPy and OpenCV only."""
