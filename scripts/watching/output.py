"""Places for files: looked at before any work is done for them, and never left with half a file."""

from __future__ import annotations

import tempfile
from pathlib import Path


def check_file(option: str, path: Path, types: tuple[str, ...]) -> None:
    """Raise ValueError where a file can't be written or isn't of one of these types; make its folder."""
    if path.suffix.lower() not in types:
        raise ValueError(f"{option} {path}: unknown file type {path.suffix!r}: must be {' or '.join(types)}")
    if path.is_dir():
        raise ValueError(f"{option} {path}: is a folder: name a file in it")
    check_folder(option, path.parent)


def check_folder(option: str, folder: Path) -> None:
    """Raise ValueError where nothing can be written into a folder, which is made if it isn't there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(f"{option}: can't write into {str(folder)!r} ({reason}): name another folder") from None
