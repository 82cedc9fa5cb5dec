# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials at right and wrong starts, and the regression on them that gives the confidence."""
