# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What `gip bench` measures: times beside OpenCV's on the same work, with the same winners."""
