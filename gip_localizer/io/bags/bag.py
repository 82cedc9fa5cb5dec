# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Bags that anyone wrote: rosbag2 folders, bare MCAP and sqlite3 files, several at once.

Topics are chosen by name or type before anything is decoded; what cannot be decoded is skipped
and named once in `Bag.notes`.

"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
import heapq
from pathlib import Path
import re
from typing import Any

from rosbags.serde import SerdeError
import yaml

from gip_localizer.errors import BagError
from gip_localizer.io.bags.sources import BagMessage, END, open_source, Source, Topic
from gip_localizer.io.cdr import jazzy

STORAGE = ('.mcap', '.db3')


class Bag:
    """
    One bag or several, as one stream of messages in order of log time.

    Parameters
    ----------
    paths : paths
        Folders or files.

    Attributes
    ----------
    topics : list of Topic
        By name; counts of all files together.
    start_ns, end_ns : int
        Log times of the first and of the last message.

    Raises
    ------
    BagError
        A path is missing, no bag, or wholly unreadable.

    """

    def __init__(self, paths: Iterable[Path | str]) -> None:
        self._notes: list[str] = []
        self._sources = [
            open_source(file) for path in paths for file in self._files(Path(path))
        ]
        self._undecodable: set[str] = set()
        counts: dict[tuple[str, str, str], int] = {}
        for topic in (topic for source in self._sources for topic in source.topics):
            key = (topic.name, topic.msgtype, topic.encoding)
            counts[key] = counts.get(key, 0) + topic.messages
        self.topics = [
            Topic(name, kind, count, encoding)
            for (name, kind, encoding), count in sorted(counts.items())
        ]
        self.start_ns = min((s.start_ns for s in self._sources if _filled(s)), default=0)
        self.end_ns = max((s.end_ns for s in self._sources if _filled(s)), default=0)
        self._note_unknown()

    @property
    def notes(self) -> list[str]:
        """What could not be read or decoded, one line each; grows while reading."""
        notes = self._notes + [note for source in self._sources for note in source.notes]
        return list(dict.fromkeys(notes))

    def messages(self, topics: Collection[str], start_ns: int = 0,
                 stop_ns: int = END) -> Iterator[BagMessage]:
        """
        Yield serialized messages in order of log time.

        Parameters
        ----------
        topics : collection of str
            Names; all others are passed over.
        start_ns, stop_ns : int
            Log times, start included, stop not.

        """
        streams = [_announced(source, topics, start_ns, stop_ns) for source in self._sources]
        for message in heapq.merge(*streams, key=lambda message: message.log_ns):
            if message.topic:
                yield message

    def decode(self, message: BagMessage) -> Any | None:
        """Return the message as an object; None, and a note, if it does not decode."""
        try:
            return jazzy().deserialize_cdr(message.raw, message.msgtype)
        except (SerdeError, IndexError, KeyError, UnicodeDecodeError) as error:
            if message.topic not in self._undecodable:
                self._undecodable.add(message.topic)
                self._notes.append(f'{message.topic}: messages that do not decode are skipped: '
                                   f'{str(error)[:160]}')
            return None

    def known(self, topic: Topic) -> bool:
        """Tell whether messages of a topic can be decoded."""
        return topic.encoding == 'cdr' and topic.msgtype in jazzy().fielddefs

    def _note_unknown(self) -> None:
        for topic in self.topics:
            if not self.known(topic):
                kind = topic.msgtype or 'no type'
                how = '' if topic.encoding == 'cdr' else f', encoding {topic.encoding!r}'
                self._notes.append(f'{topic.name}: skipped, unknown type ({kind}{how})')

    def _files(self, path: Path) -> list[Path]:
        try:
            if path.is_dir():
                return self._files_of_folder(path)
            exists = path.exists()
        except OSError as error:
            raise BagError(f'{path}: cannot be read: {error.strerror}') from None
        if not exists:
            raise BagError(f'{path}: no such bag; give a rosbag2 folder, an .mcap or a .db3 file')
        if path.suffix not in STORAGE:
            hint = ' (convert ROS 1 bags with rosbags-convert)' if path.suffix == '.bag' else ''
            raise BagError(f'{path}: is no .mcap and no .db3 file{hint}')
        return [path]

    def _files_of_folder(self, folder: Path) -> list[Path]:
        found = sorted((f for f in folder.iterdir() if f.suffix in STORAGE), key=_natural)
        info = self._metadata(folder)
        if str((info or {}).get('compression_mode')).lower() in ('file', 'message'):
            return [folder]
        if not found:
            raise BagError(
                f'{folder}: holds no .mcap and no .db3 file; give the folder that ros2 bag '
                'record made (its .zstd files need their metadata.yaml)'
            )
        names = (info or {}).get('relative_file_paths')
        listed = [Path(str(name)).name for name in (names if isinstance(names, list) else ())]
        missing = [name for name in listed if not (folder / name).is_file()]
        if missing:
            self._notes.append(f'{folder}: files of the bag are missing: {", ".join(missing)}')
        return found

    def _metadata(self, folder: Path) -> dict[str, Any] | None:
        path = folder / 'metadata.yaml'
        try:
            info = yaml.safe_load(path.read_text(encoding='utf-8'))['rosbag2_bagfile_information']
        except FileNotFoundError:
            self._notes.append(f'{folder}: has no metadata.yaml; its files are read without it')
            return None
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
            self._notes.append(f'{path}: unreadable; the files are read without it')
            return None
        return info if isinstance(info, dict) else None


def _filled(source: Source) -> bool:
    return any(topic.messages for topic in source.topics)


def _announced(source: Source, topics: Collection[str], start_ns: int,
               stop_ns: int) -> Iterator[BagMessage]:
    """Yield a nameless message first, so that a file is opened only when its time has come."""
    yield BagMessage('', '', source.start_ns, b'')
    yield from source.messages(topics, start_ns, stop_ns)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Order bag_2 before bag_10."""
    parts = re.split(r'(\d+)', path.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]
