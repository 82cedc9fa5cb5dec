# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Step 4: from the best candidates to continuous poses with covariance."""
