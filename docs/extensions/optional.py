"""Takes in files that other commands make, and which may not be there yet.

In a page `<!-- optional: FILE | TEXT -->` stands for a Markdown file in a folder of its own beside the page: without
its title, its headings from the second level on. Where there is no such file, the text stands there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # so that the tests can do without Sphinx
    from sphinx.application import Sphinx

MARK = re.compile(r"<!-- optional: (\S+) \| (.+?) -->")


def taken_in(file: Path, folder: Path) -> str:
    """The file's text as part of a page in `folder`.

    Args:
        file: Markdown.
        folder: of the page; pictures are found from there.
    """
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("# ")]
    levels = [len(match[1]) for line in lines if (match := re.match(r"(#+) ", line))]
    shift = 2 - min(levels, default=2)
    lines = [re.sub(r"^(#+) ", lambda match: "#" * (len(match[1]) + shift) + " ", line) for line in lines]
    prefix = file.parent.relative_to(folder).as_posix()
    return re.sub(r"\]\((?!\w+:|#|/)", f"]({prefix}/", "\n".join(lines))


def fill(app: Sphinx, page: str, source: list[str]) -> None:
    folder = Path(app.env.doc2path(page)).parent

    def replacement(mark: re.Match[str]) -> str:
        file = folder / mark[1]
        app.env.note_dependency(str(file))
        return taken_in(file, folder) if file.is_file() else mark[2]

    source[0] = MARK.sub(replacement, source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}
