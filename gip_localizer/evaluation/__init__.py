# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of runs: replay, metrics, reports, comparison and the suites of `gip evaluate`."""
