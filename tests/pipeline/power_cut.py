"""A disk that loses at a power cut whatever was not synced.

    written ──► cache ──fsync of the file──► its content          ┐ what is there
    named   ──► cache ──fsync of the folder──► the folder's names ┘ after the cut

A real file system may keep more; this one keeps what it must and nothing else.
"""

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch


class Disk:
    """What of a folder and the folders in it has been synced."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._contents: dict[int, bytes] = {}  # by inode
        self._names: dict[Path, dict[str, int]] = {}  # folder → name → inode
        self.syncs = 0
        self._note_all()

    def _note_all(self) -> None:
        """What lies there has been there for long."""
        for path in (self._folder, *self._folder.rglob("*")):
            self._note(path)

    def _note(self, path: Path) -> None:
        if path.is_dir():
            self._names[path] = {each.name: each.stat().st_ino for each in path.iterdir()}
        else:
            self._contents[path.stat().st_ino] = path.read_bytes()

    def sync(self, descriptor: int) -> None:
        """Take the place of os.fsync."""
        self.syncs += 1
        path = Path(f"/proc/self/fd/{descriptor}").resolve()
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            self._note(path)
        elif path.is_relative_to(self._folder):
            self._contents[os.fstat(descriptor).st_ino] = path.read_bytes()

    def cut(self) -> None:
        """Leave of the folder what is on disk."""
        kept = self._restored(self._folder)
        for path in self._folder.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        for path, content in kept.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        self._contents.clear()
        self._names.clear()
        self._note_all()

    def _restored(self, folder: Path) -> dict[Path, bytes]:
        found: dict[Path, bytes] = {}
        for name, inode in self._names.get(folder, {}).items():
            path = folder / name
            if path in self._names:
                found |= self._restored(path)
            else:
                found[path] = self._contents.get(inode, b"")
        return found


@contextmanager
def power_cut(folder: Path) -> Iterator[Disk]:
    """Run what is in the context on such a disk, and cut its power in the end."""
    disk = Disk(folder)
    with patch("os.fsync", disk.sync):
        yield disk
    disk.cut()
