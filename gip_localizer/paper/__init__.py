# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The paper that this package follows, reproduced and then tested on images.

Flanagan, Khublani, Chamberland, Agarwal, Vora: *Localization in Autonomous Vehicles Using a
Generalized Inner Product*. In reading order: `geometry` and `theory` hold its equations,
`squares` its 66 squares, `exact`, `spread` and `sampling` its simulated figure, `curves` puts
them beside the printed points. `pipeline` repeats the experiment on rendered images, `beyond`
and `peers` take it to the task of a vehicle.

"""
