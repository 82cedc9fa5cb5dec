# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Step 1: camera image to the mean and the footprint area of every road cell."""
