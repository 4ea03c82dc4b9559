"""Recordings behind a URL: s3://, gs://, az:// and whatever else fsspec opens.

    reprocess 's3://bucket/t07/**/*.mcap'
        │ listing: names, sizes, tags of content
    a worker ─► a copy in its temporary folder ─► read as any file ─► removed

A URL travels as a Path ("s3:/bucket/a.mcap"), as files of disks do; `url_of` writes it out again.
Keys and addresses of servers come from the environment, as each library of fsspec reads them.
"""

import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.recording.errors import RecordingError
from sensors.errors import InputError

TAGS = ("ETag", "etag", "md5Hash", "content_md5", "LastModified", "updated", "mtime", "created")


def is_remote(text: str) -> bool:
    """Whether a text is a URL of a file or a pattern of them."""
    scheme, mark, _ = text.partition("://")
    return bool(mark) and scheme.isalnum() and len(scheme) > 1


def name_of(path: Path) -> str:
    """Return a file's name for people: its URL, or its path."""
    return url_of(path) or str(path)


def url_of(path: Path) -> str:
    """Return the URL that a path stands for; "" for a file of a disk."""
    first = path.parts[0] if path.parts else ""
    if not first.endswith(":") or not is_remote(f"{first}//"):
        return ""
    return f"{first}//{'/'.join(path.parts[1:])}"


def remote_files(pattern: str) -> list[Path]:
    """Return the recordings that a URL names: a file, a folder with all below it, a pattern.

    Raises
    ------
    InputError
        If they cannot be listed.
    """
    system, scheme = _system(pattern), pattern.partition("://")[0]
    try:
        if any(letter in pattern for letter in "*?["):
            found = system.glob(pattern)
        elif pattern.endswith(".mcap"):
            found = [pattern] if system.exists(pattern) else []
        else:
            found = [each for each in system.find(pattern) if each.endswith(".mcap")]
    except Exception as error:  # each library of fsspec raises its own
        raise InputError(f"{pattern}: {_sentence(error)}") from error
    names = (str(each).partition("://")[2] or str(each).lstrip("/") for each in found)
    return sorted(Path(f"{scheme}:/{name}") for name in names)


def remote_stamp(url: str) -> tuple[int, int] | None:
    """Size [bytes] and a number that changes with the content; None where the file is gone.

    Raises
    ------
    RecordingError
        If the server does not answer.
    """
    try:
        info = _system(url).info(url)
    except OSError:
        return None
    except Exception as error:  # each library of fsspec raises its own
        raise RecordingError(f"{url} cannot be fetched: {_sentence(error)}") from error
    tag = next((str(info[name]) for name in TAGS if info.get(name) is not None), "")
    digest = hashlib.blake2b(tag.encode(), digest_size=6).digest()
    return int(info.get("size") or 0), int.from_bytes(digest, "big")


@contextmanager
def on_disk(path: Path) -> Iterator[Path]:
    """A file on this machine with the content of one that may be elsewhere.

    Raises
    ------
    RecordingError
        If it cannot be fetched; of what is read of the copy, by its URL.
    """
    url = url_of(path)
    if not url:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="pilewatch-") as folder:
        copy = Path(folder) / path.name
        try:
            _system(url).get_file(url, str(copy))
        except Exception as error:  # each library of fsspec raises its own
            raise RecordingError(f"{url} cannot be fetched: {_sentence(error)}") from error
        try:
            yield copy
        except RecordingError as error:
            raise RecordingError(str(error).replace(str(copy), url)) from error


def _system(url: str) -> Any:
    """Return the library that opens a URL.

    Raises InputError where it is missing.
    """
    scheme = url.partition("://")[0]
    try:
        return import_module("fsspec").filesystem(scheme)
    except ImportError as error:
        raise InputError(f"{url}: {scheme}:// needs a package: {_sentence(error)}") from error
    except ValueError as error:
        raise InputError(f"{url}: {_sentence(error)}") from error


def _sentence(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
