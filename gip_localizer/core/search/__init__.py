# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where candidates are looked for: a window about a prior, or the whole map."""
