// SPDX-FileCopyrightText: gip_localizer contributors
// SPDX-License-Identifier: Apache-2.0

// One more whenever a function takes other arguments; as in binding.py
const int kernels_version = 1;
