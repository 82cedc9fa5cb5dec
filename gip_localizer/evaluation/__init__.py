# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Judging runs: metrics, reports, the paper, benchmarks."""
