# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Bag files: reading, writing, topics, recorded camera and ground truth."""
