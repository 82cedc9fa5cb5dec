# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The nodes; the only folder that imports rclpy."""

import os

# Read when NumPy is loaded. The matrices are small: threads of BLAS would spin more than compute
# (measured: 2.5 times the processor time per frame), beside a camera driver that needs the cores.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
