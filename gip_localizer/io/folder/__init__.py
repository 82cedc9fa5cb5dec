# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives as folders of images, with stamps, calibration and poses in files next to them."""
