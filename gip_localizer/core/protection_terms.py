# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Tails of the errors: written by `make fit-protection`, not by hand."""

TAILS = ((4.0, 1.2), (4.0, 1.2), (4.0, 1.2))
"""Ahead, left, heading: degrees of freedom and scale of the Student t that bounds the error."""
