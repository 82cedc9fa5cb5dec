# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Tails of the errors: written by `make fit-protection`, not by hand."""

TAILS = ((5.0, 1.63), (5.0, 1.63), (3.0, 1.22))
"""Ahead, left, heading: degrees of freedom and scale of the Student t that bounds the error."""
