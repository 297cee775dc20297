"""Measured tables inside a document, each between the lines `<!-- begin NAME -->` and `<!-- end NAME -->`."""

from __future__ import annotations

from pathlib import Path


def put(document: Path, name: str, table: str) -> None:
    """Replace the table `name` in a document. Raises ValueError where the document has no place for it."""
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
    before, found, rest = document.read_text().partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"{document} has no lines `{begin.strip()}` and `{end}`")
    document.write_text(f"{before}{begin}\n{table}\n\n{end}{after}")
