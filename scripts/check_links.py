"""Follow every link of a built site: pages, files and places in pages must be there. Addresses elsewhere are listed."""

from __future__ import annotations

import argparse
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """What a page links to, and the places in it that others can link to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.places.add(value)
            elif name in ("href", "src") and not (tag == "link" and value.startswith("#")):
                self.links.append(value)


def check(site: Path) -> tuple[list[str], dict[str, list[str]]]:
    """What is wrong in a site, a line each, and by address elsewhere the pages that link to it.

    Raises:
        ValueError: there is no page.
    """
    pages = {file: Page(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    if not pages:
        raise ValueError(f"site = {str(site)!r}: must be a folder with HTML pages")
    faults: list[str] = []
    elsewhere: dict[str, list[str]] = {}
    for file, page in pages.items():
        name = file.relative_to(site).as_posix()
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https") or parts.netloc:
                elsewhere.setdefault(link, []).append(name)
            elif not parts.scheme:
                target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
                target = target / "index.html" if target.is_dir() else target
                if not target.is_file():
                    faults.append(f"{name}: {link}: no such file")
                elif target in pages and unquote(parts.fragment) not in pages[target].places:
                    faults.append(f"{name}: {link}: no such place in that page")
    return faults, elsewhere


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path, nargs="?", default=Path("site"))
    faults, elsewhere = check(parser.parse_args().site.resolve())
    print(
        "\n".join(f"elsewhere, not fetched: {address} (in {pages[0]})" for address, pages in sorted(elsewhere.items()))
    )
    print("\n".join(faults) or "all links within the site lead somewhere")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
