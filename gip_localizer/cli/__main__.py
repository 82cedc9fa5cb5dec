# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`python -m gip_localizer.cli`: the same as `gip`."""

import sys

from gip_localizer.cli import main

if __name__ == '__main__':
    sys.exit(main())
