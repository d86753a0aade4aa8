"""Pages made elsewhere in the project, which may not be there yet: `{optional} PATH` takes one in, or says how to make it.

The path counts from the page's folder. The directive's content stands in where there is no such file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Optional(SphinxDirective):  # type: ignore[misc]
    """Markdown from a file, its own title left out."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        page = Path(self.env.doc2path(self.env.docname))
        file = page.parent / self.arguments[0]
        self.env.note_dependency(str(file))
        if not file.is_file():
            return list(self.parse_content_to_nodes())
        lines = file.read_text(encoding="utf-8").splitlines()
        text = "\n".join(line for line in lines if not line.startswith("# "))
        return list(self.parse_text_to_nodes(text, allow_section_headings=True))


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("optional", Optional)
    return {"parallel_read_safe": True}
