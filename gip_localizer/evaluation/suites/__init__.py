# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The suites of `gip evaluate`: what is tried, what is demanded, what came of it."""
