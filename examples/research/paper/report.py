"""report.html: one file, its pictures inside it, figure by figure as the paper has them."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem;
  color: #222; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin: 2.2rem 0 0.3rem; }
.place { color: #666; margin: 0 0 0.6rem; } img { max-width: 100%; height: auto; }
.table { overflow-x: auto; } table { border-collapse: collapse; margin: 0.6rem 0; }
th, td { border-bottom: 1px solid #ddd; padding: 0.25rem 0.6rem; text-align: right;
  vertical-align: top; font-size: 0.86rem; }
th:first-child, td:first-child { text-align: left; } .words td { text-align: left; }
"""


@dataclass(frozen=True)
class Section:
    """A part of the report."""

    title: str
    place: str
    """Figure or section of the paper."""
    text: str = ""
    pictures: Sequence[str] = ()
    """Names of PNG files in the folder; those that are not there are left out."""
    tables: Sequence[str] = ()
    """Names of the tables in order."""
    words: bool = False
    """Whether the tables hold sentences."""


def report(
    title: str, intro: str, sections: Sequence[Section], tables: Mapping[str, str], folder: Path
) -> str:
    """The page. It loads nothing and runs nothing."""
    parts = [f"<h1>{html.escape(title)}</h1>", f"<p>{html.escape(intro)}</p>"]
    for section in sections:
        pictures = [folder / name for name in section.pictures if (folder / name).exists()]
        found = [tables[name] for name in section.tables if name in tables]
        if not pictures and not found:
            continue
        parts.append(f"<h2>{html.escape(section.title)}</h2>")
        parts.append(f'<p class="place">In the paper: {html.escape(section.place)}</p>')
        if section.text:
            parts.append(f"<p>{html.escape(section.text)}</p>")
        parts += [_picture(path, section.title) for path in pictures]
        parts += [_table(table, words=section.words) for table in found]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )


def _picture(path: Path, title: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    name = html.escape(f"{title}: {path.stem.replace('_', ' ')}", quote=True)
    return f'<p><img alt="{name}" src="data:image/png;base64,{data}"></p>'


def _table(markdown: str, *, words: bool) -> str:
    """A Markdown table as HTML."""
    head, _, *rows = [
        [html.escape(cell.strip()) for cell in line.strip().strip("|").split("|")]
        for line in markdown.strip().splitlines()
    ]
    lines = ["<tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows]
    kind = ' class="words"' if words else ""
    return f'<div class="table"><table{kind}>' + "\n".join(lines) + "</table></div>"
