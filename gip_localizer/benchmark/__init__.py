# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The measurements of `gip bench`: speed compared with OpenCV on the same work."""
