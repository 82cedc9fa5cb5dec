# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The suites of `gip evaluate`: their trials, bounds and result tables."""
