# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The images of a folder with their stamps, in order of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gip_localizer.core.arrays import Grey
from gip_localizer.errors import ImageError, MapError
from gip_localizer.io.folder.stamps import Stamp, stamps_of
from gip_localizer.io.natural_order import natural_key
from gip_localizer.io.pictures import read_picture

SUFFIXES = ('.png', '.jpg', '.jpeg', '.pgm', '.ppm', '.tif', '.tiff', '.bmp', '.webp')


@dataclass(frozen=True)
class ImageFolder:
    """
    The images of a drive.

    Attributes
    ----------
    folder : Path
        Where the images are.
    images : list of (Stamp, Path)
        Nanoseconds and file, in order of time.
    notes : list of str
        What was chosen or left out.

    """

    folder: Path
    images: list[tuple[Stamp, Path]]
    notes: list[str]

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.images)

    def pictures(self) -> Iterator[tuple[Stamp, Grey]]:
        """
        Yield stamp and grey picture of each image.

        Raises
        ------
        ImageError
            A picture cannot be read, or has another size than the first.

        """
        first: tuple[Path, tuple[int, ...]] | None = None
        for stamp, path in self.images:
            try:
                grey = read_picture(str(path), path)[0]
            except MapError as error:
                raise ImageError(str(error)) from None
            if first is None:
                first = (path, grey.shape)
            elif grey.shape != first[1]:
                raise ImageError(
                    f'the images have two sizes: {first[0].name} {_size(first[1])} and '
                    f'{path.name} {_size(grey.shape)}; expected one camera in one mode: import '
                    'each into a bag of its own'
                )
            yield stamp, grey


def find_images(
    folder: Path, *, images: Path | None = None, stamps: Path | None = None,
    rate: float | None = None,
) -> ImageFolder:
    """
    Find the images of a folder and give each its stamp.

    Parameters
    ----------
    folder : Path
        The images, or folders of which one holds images.
    images : Path or None
        Folder of the images where several have some, within `folder` or any other.
    stamps : Path or None
        File of the stamps; None: found by its name, or the images are named by their stamps.
    rate : float or None
        Images per second, if there are no stamps.

    Raises
    ------
    ImageError
        No images, or several folders of images.
    StampError
        No stamps, or such that do not fit the images.

    """
    source = _source(folder, images)
    found = _images_in(source)
    pairs, notes = stamps_of(found, (folder, source), file=stamps, rate=rate)
    return ImageFolder(source, pairs, notes)


def _source(folder: Path, images: Path | None) -> Path:
    if not folder.is_dir():
        raise ImageError(f'{folder}: is no folder; expected one that holds images')
    if images is not None:
        inside = folder / images
        source = inside if inside.is_dir() else images
        if not source.is_dir() or not _images_in(source):
            raise ImageError(f'--images {images}: is no folder that holds images')
        return source
    if _images_in(folder):
        return folder
    subfolders = sorted((path for path in folder.iterdir() if path.is_dir()), key=natural_key)
    holding = [path for path in subfolders if _images_in(path)]
    if len(holding) > 1:
        names = ', '.join(path.name for path in holding)
        raise ImageError(f'{folder}: several folders hold images ({names}); choose one with '
                         '--images')
    if not holding:
        raise ImageError(
            f'{folder}: holds no images ({", ".join(SUFFIXES)}), nor does a folder in it; name '
            'their folder with --images'
        )
    return holding[0]


def _images_in(folder: Path) -> list[Path]:
    files = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    return sorted((path for path in files if path.is_file()), key=natural_key)


def _size(shape: tuple[int, ...]) -> str:
    return f'({shape[1]}x{shape[0]})'
