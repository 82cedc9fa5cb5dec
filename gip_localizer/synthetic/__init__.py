# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Rendered cameras over synthetic roads, with ground truth."""
