# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Reading of rosbag2 folders, and of single MCAP and sqlite3 files, from any recorder.

Topics are chosen by name or type before messages are decoded. Messages that cannot be decoded are
skipped and reported once in `Bag.notes`.

"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
import heapq
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from zstandard import ZstdError

from gip_localizer.errors import BagError, shortened
from gip_localizer.io.bags.compression import is_compressed, storage_suffix, uncompressed
from gip_localizer.io.bags.log_times import drive_times
from gip_localizer.io.bags.source import BagMessage, END, Source, Topic
from gip_localizer.io.bags.sources import open_source
from gip_localizer.io.cdr import jazzy
from gip_localizer.io.foxglove_video import packet_of, VIDEO
from gip_localizer.io.natural_order import natural_key
from gip_localizer.parameters.yaml_files import read_yaml, user_path, YamlFileError

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
        Sorted by name; counts are those of all files together.
    start_ns, end_ns : int
        Log times of the drive's first and last message (see `log_times`).

    Raises
    ------
    BagError
        A path does not exist, is not a bag, or nothing in it can be read.

    """

    def __init__(self, paths: Iterable[Path | str]) -> None:
        self._notes: list[str] = []
        self._sources = [
            open_source(file) for path in paths for file in self._files(user_path(path))
        ]
        self._undecodable: set[str] = set()
        self.topics = _merged(topic for source in self._sources for topic in source.topics)
        filled = [source for source in self._sources if any(t.messages for t in source.topics)]
        self.start_ns, self.end_ns, strays = drive_times(
            min((source.start_ns for source in filled), default=0),
            max((source.end_ns for source in filled), default=0),
            lambda: (m.log_ns for m in self.messages({topic.name for topic in self.topics})),
        )
        self._notes += [strays] if strays else []
        self._note_unknown()

    @property
    def notes(self) -> list[str]:
        """Warnings about unreadable parts, one line each; grows while reading."""
        notes = self._notes + [note for source in self._sources for note in source.notes]
        return list(dict.fromkeys(notes))

    def messages(self, topics: Collection[str], start_ns: int = 0,
                 stop_ns: int = END) -> Iterator[BagMessage]:
        """
        Yield serialized messages in order of log time.

        Parameters
        ----------
        topics : collection of str
            Names; other topics are ignored.
        start_ns, stop_ns : int
            Log times: start <= log time < stop.

        """
        streams = [_announced(source, topics, start_ns, stop_ns) for source in self._sources]
        for message in heapq.merge(*streams, key=lambda message: message.log_ns):
            if message.topic and (raw := self._plain(message)) is not None:
                yield message._replace(raw=raw)

    def _plain(self, message: BagMessage) -> bytes | None:
        """Return the uncompressed bytes of a message; None, and a note, if they are damaged."""
        try:
            return uncompressed(message.raw)
        except (ZstdError, MemoryError) as error:
            self._note_skipped(message.topic, error)
            return None

    def decode(self, message: BagMessage) -> Any | None:
        """Return the message as an object; None, and a note, if it does not decode."""
        try:
            decoded = jazzy().deserialize_cdr(message.raw, message.msgtype)
            return packet_of(decoded) if message.msgtype == VIDEO else decoded
        except (SerdeError, IndexError, KeyError, UnicodeDecodeError) as error:
            self._note_skipped(message.topic, error)
            return None

    def _note_skipped(self, topic: str, error: BaseException) -> None:
        if topic not in self._undecodable:
            self._undecodable.add(topic)
            self._notes.append(f'{topic}: messages that do not decode are skipped: '
                               f'{shortened(str(error))}')

    def known(self, topic: Topic) -> bool:
        """Whether messages of a topic can be decoded."""
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
        if storage_suffix(path) not in STORAGE:
            ros1 = path.suffix.lower() == '.bag'
            hint = ' (convert ROS 1 bags with rosbags-convert)' if ros1 else ''
            raise BagError(f'{path}: is no .mcap and no .db3 file{hint}')
        return [path]

    def _files_of_folder(self, folder: Path) -> list[Path]:
        stored = {f.name: f for f in folder.iterdir() if storage_suffix(f) in STORAGE}
        found = sorted((f for f in stored.values()
                        if not (is_compressed(f) and f.stem in stored)), key=natural_key)
        info = self._metadata(folder)
        if not found:
            raise BagError(
                f'{folder}: holds no .mcap and no .db3 file, nor one compressed to .zstd; give '
                'the folder that ros2 bag record made'
            )
        names = (info or {}).get('relative_file_paths')
        listed = [Path(str(name)).name for name in (names if isinstance(names, list) else ())]
        missing = [name for name in listed
                   if not {name, Path(name).stem} & {file.name for file in found}]
        if missing:
            self._notes.append(f'{folder}: files of the bag are missing: {", ".join(missing)}')
        return found

    def _metadata(self, folder: Path) -> dict[str, Any] | None:
        path = folder / 'metadata.yaml'
        try:
            info = read_yaml(path)['rosbag2_bagfile_information']
        except FileNotFoundError:
            self._notes.append(f'{folder}: has no metadata.yaml; its files are read without it')
            return None
        except (YamlFileError, KeyError, TypeError):
            self._notes.append(f'{path}: unreadable; the files are read without it')
            return None
        return info if isinstance(info, dict) else None


def _merged(parts: Iterable[Topic]) -> list[Topic]:
    """Return the topics of all files, by name: counts added up, offers one after another."""
    found: dict[tuple[str, str, str], Topic] = {}
    for part in parts:
        key = (part.name, part.msgtype, part.encoding)
        known = found.get(key)
        found[key] = part if known is None else known._replace(
            messages=known.messages + part.messages, offered=known.offered + part.offered
        )
    return [found[key] for key in sorted(found)]


def _announced(source: Source, topics: Collection[str], start_ns: int,
               stop_ns: int) -> Iterator[BagMessage]:
    """Yield an empty message first, so that `heapq.merge` opens a file only when needed."""
    yield BagMessage('', '', source.start_ns, b'')
    yield from source.messages(topics, start_ns, stop_ns)
