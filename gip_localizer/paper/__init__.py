# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The paper that this package follows, reproduced and tested on images.

Flanagan, Khublani, Chamberland, Agarwal, Vora: *Localization in Autonomous Vehicles Using a
Generalized Inner Product*. In reading order: `geometry` and `theory` hold its equations and
`squares` its 66 squares. `exact`, `standard_error` and `sampling` compute its simulated figure,
and `curves` compares them with the printed points. `image_experiment` repeats the experiment on
rendered images. `baseline_comparison` and `baselines` extend it to the task of a vehicle.

"""
