# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The road map as a raster, its resampled levels and the parts that are cut from it."""
