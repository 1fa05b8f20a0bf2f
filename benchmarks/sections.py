"""Parts of a document that different scripts write."""

from __future__ import annotations

from pathlib import Path


def replace_section(path: Path, name: str, text: str) -> None:
    """Write a part between its marks; what is outside them stays. A new part comes last."""
    start, end = f"<!-- {name} -->\n", f"<!-- /{name} -->\n"
    whole = path.read_text(encoding="utf-8") if path.is_file() else ""
    part = f"{start}\n{text.strip()}\n\n{end}"
    if start in whole and end in whole:
        before, rest = whole.split(start, 1)
        after = rest.split(end, 1)[1]
        path.write_text(before + part + after, encoding="utf-8")
    else:
        path.write_text(whole + ("\n" if whole else "") + part, encoding="utf-8")
