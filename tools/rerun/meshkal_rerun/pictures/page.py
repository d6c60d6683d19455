# SPDX-License-Identifier: MIT
"""Pieces of a web page that stands alone: no scripts, nothing from elsewhere, readable in light, in dark and on paper."""

import base64
import html
import re
from collections.abc import Iterable, Sequence

STYLE = """
:root { color-scheme: light dark; --ink: #1b1e22; --page: #ffffff; --faint: #5b636d; --line: #d5dae0; --row: #f4f6f8; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --page: #14171a; --faint: #a3abb5; --line: #3a4149; --row: #1d2126; } }
body { margin: 0 auto; max-width: 62rem; padding: 1.5rem; color: var(--ink); background: var(--page); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; }
p { margin: .4rem 0; } .faint { color: var(--faint); }
table { border-collapse: collapse; font-size: .92rem; max-width: 100%; }
caption { text-align: left; color: var(--faint); padding-bottom: .3rem; }
th, td { text-align: left; padding: .25rem .9rem .25rem .4rem; border-bottom: 1px solid var(--line); vertical-align: top; overflow-wrap: anywhere; }
tbody tr:nth-child(odd) { background: var(--row); } td.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1.4rem 0; } figcaption { margin-bottom: .3rem; }
/* Figures are drawn for white paper. */
figure img { display: block; max-width: 100%; height: auto; background: #fff; border-radius: 4px; }
pre { overflow-x: auto; padding: .7rem; background: var(--row); border: 1px solid var(--line); border-radius: 4px; white-space: pre-wrap; overflow-wrap: anywhere; }
code { font-family: ui-monospace, monospace; font-size: .92em; }
@media print { :root { --ink: #000; --page: #fff; --faint: #444; --line: #bbb; --row: #f4f4f4; } body { max-width: none; padding: 0; font-size: 10pt; }
  figure, tr { break-inside: avoid; } h2 { break-after: avoid; } details { display: none; } }
"""


def page(title: str, parts: Iterable[str]) -> str:
    body = "\n".join(parts)
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{text(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n")


def text(value: object) -> str:
    """Escaped; what HTML does not allow as a character is a question mark."""
    return html.escape(re.sub(r"[^\t\n\r -~\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", str(value)))


def marked(value: str) -> str:
    """Escaped, with Markdown's **strong** and `code`."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", text(value)))


def heading(value: str) -> str:
    return f"<h2>{text(value)}</h2>"


def paragraph(value: str, kind: str = "") -> str:
    return f"<p{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{marked(value)}</p>"


def facts(rows: Sequence[tuple[str, str]], caption: str) -> str:
    """Names and values."""
    lines = "\n".join(f'<tr><th scope="row">{marked(name)}</th><td>{marked(value)}</td></tr>' for name, value in rows)
    return f"<table>\n<caption>{text(caption)}</caption>\n<tbody>\n{lines}\n</tbody>\n</table>"


def table(names: Sequence[str], rows: Iterable[Sequence[object]], caption: str) -> str:
    """What looks like a number is set as one."""
    head = "".join(f'<th scope="col">{text(name)}</th>' for name in names)
    lines = "\n".join("<tr>" + "".join(_cell(value) for value in row) + "</tr>" for row in rows)
    return f"<table>\n<caption>{text(caption)}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{lines}\n</tbody>\n</table>"


def _cell(value: object) -> str:
    number = re.fullmatch(r"-?[0-9.]+(e[+-]?[0-9]+)?", str(value))
    return f'<td class="number">{text(value)}</td>' if number else f"<td>{marked(str(value))}</td>"


def figure(data: bytes, kind: str, title: str, alt: str) -> str:
    """kind: svg+xml or png."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return f'<figure>\n<figcaption>{text(title)}</figcaption>\n<img src="{source}" alt="{text(alt)}">\n</figure>'


def code(value: str) -> str:
    return f"<pre><code>{text(value)}</code></pre>"


def folded(summary: str, inside: str) -> str:
    return f"<details>\n<summary>{text(summary)}</summary>\n{inside}\n</details>"
