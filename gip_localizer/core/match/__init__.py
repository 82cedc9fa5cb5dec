# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Step 3: view and map window to the score of every candidate, and the posterior."""
