# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Errors a user can mend: each message names what was found, what was expected and the remedy.

A frame that cannot be localized is not an error: it is an `Estimate` with a `Status`.

"""

LINE = 160
"""Largest number of characters of a file or value that a message quotes; chosen."""


def quoted(value: object) -> str:
    """Return a value as Python writes it, on one line of at most `LINE` characters."""
    return shortened(repr(value))


def shortened(text: str) -> str:
    """Return a text on one line of at most `LINE` characters."""
    line = ' '.join(text[: 4 * LINE].split())
    return line if len(line) <= LINE else line[: LINE - 1] + '…'


class GipError(Exception):
    """Base of every error that this package raises on purpose."""


class MapError(GipError):
    """A map YAML or its image cannot be used."""


class CalibrationError(GipError):
    """A CameraInfo or the extrinsics cannot be used."""


class ImageError(GipError):
    """An image message cannot be decoded."""


class BagError(GipError):
    """A bag cannot be opened, or lacks what is needed."""


class ParameterError(GipError):
    """A parameter is unknown, of the wrong type or out of range."""


class OutputError(GipError):
    """A results folder or file cannot be written."""


class TrajectoryError(GipError):
    """A trajectory file is malformed."""
