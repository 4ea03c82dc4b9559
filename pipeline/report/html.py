"""Build a self-contained HTML page: its frame, tables and pictures.

One file, no script, nothing loaded from elsewhere: it can be mailed, opened on a phone, in dark
mode, and printed. What is wider than the screen (a table, a listing) scrolls by itself.
"""

import base64
import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pipeline.report.canvas import css_colour
from pipeline.viewer.pictures import colours

PAGE_STYLE = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 62rem; margin: 0 auto; padding: 1rem; overflow-wrap: break-word; }
h1 { line-height: 1.2; margin-bottom: .25rem; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #8886; }
.wide { overflow-x: auto;  /* shadows where there is more to scroll to */
  background: linear-gradient(to right, Canvas 1.5rem, #0000) 0 / 3rem 100% no-repeat local,
    linear-gradient(to left, Canvas 1.5rem, #0000) 100% / 3rem 100% no-repeat local,
    linear-gradient(to right, #8888, #0000) 0 / .75rem 100% no-repeat scroll,
    linear-gradient(to left, #8888, #0000) 100% / .75rem 100% no-repeat scroll; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #8886;
  white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
.title { font-weight: 600; margin: 1rem 0 0; padding: .25rem 0; break-after: avoid; }
.words { text-align: left; min-width: 14rem; white-space: normal; }
img { max-width: 100%; background: white; }
figure { margin: 1rem 0; break-inside: avoid; }
figure svg { display: block; width: 100%; height: auto; }
figcaption, .quiet { font-size: .875rem; opacity: .8; }
pre { overflow-x: auto; font-size: .8rem; }
@media (max-width: 40rem) {
  .wrapping th, .wrapping td { white-space: normal; padding: .25rem .4rem; }
  .wrapping td:first-child { min-width: 6.4rem; }  /* a date */
  .wrapping .words { min-width: 9rem; }
}
@media print {
  :root { color-scheme: light; font-size: 11px; }
  body { max-width: none; padding: 0; }
  .wide, pre { overflow: visible; background: none; }
  pre { white-space: pre-wrap; }
  td { white-space: normal; }
  h2, h3 { break-after: avoid; }
  tr { break-inside: avoid; }
}
"""

_NO_ICON = '<link rel="icon" href="data:,">'  # else a browser requests one
REPORT_STYLE = f"""
.verdict {{ font-size: 1.25rem; padding: .5rem .75rem; border-left: .4rem solid; }}
.good {{ border-color: {css_colour(colours.TRUTH)}; }}
.doubt {{ border-color: {css_colour(colours.MODEL)}; }}
.bad {{ border-color: {css_colour(colours.FAULT)}; }}
.unknown {{ border-color: {css_colour(colours.NEUTRAL)}; }}
.cards {{ display: grid; gap: .75rem; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr));
  margin: 1rem 0; }}
.cards div {{ border: 1px solid #8886; border-radius: .4rem; padding: .5rem .75rem; }}
.cards dt {{ font-size: .875rem; opacity: .8; }}
.cards dd {{ margin: 0; white-space: nowrap; font-size: 1.15rem;
  font-variant-numeric: tabular-nums; }}
.pair {{ display: grid; gap: 0 1.5rem; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 24rem), 1fr)); }}
.pair figure {{ max-width: 36rem; }}
"""


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table of finished texts."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: tuple[int, ...] = ()
    """Columns that hold sentences rather than figures."""


def document(title: str, body: str, style: str = "") -> str:
    """Return the whole page.

    Parameters
    ----------
    body : str
        HTML of the page's body.
    style : str, optional
        Rules beside `PAGE_STYLE`.
    """
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"{_NO_ICON}<style>{PAGE_STYLE}{style}</style></head>\n<body><h1>{html.escape(title)}</h1>\n"
        f"{body}</body></html>\n"
    )


def heading(text: str, level: int = 2, *, anchor: str = "") -> str:
    """Return a heading; `anchor` is what links within the page jump to."""
    place = f' id="{html.escape(anchor)}"' if anchor else ""
    return f"<h{level}{place}>{html.escape(text)}</h{level}>\n"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of plain text; `kind` is a class of the style."""
    return f"<p{_class(kind)}>{html.escape(text)}</p>\n"


def bullet_list(texts: Iterable[str]) -> str:
    """Return a list of plain sentences; nothing where there are none."""
    items = "".join(f"<li>{html.escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>\n" if items else ""


def table_html(content: TextTable, links: Sequence[str] = ()) -> str:
    """Return a table that scrolls where it is wider than the screen.

    Parameters
    ----------
    links : Sequence[str], optional
        Target of the first cell of each row, e.g. "#t1"; empty: no links.
    """
    head = "".join(
        f'<th scope="col"{_class("words" if column in content.words else "")}>'
        f"{html.escape(text)}</th>"
        for column, text in enumerate(content.head)
    )
    rows = []
    for number, row in enumerate(content.rows):
        cells = [
            f"<td{_class('words' if column in content.words else '')}>{html.escape(text)}</td>"
            for column, text in enumerate(row)
        ]
        if links:
            link = f'<a href="{html.escape(links[number])}">{html.escape(row[0])}</a>'
            cells[0] = f"<td>{link}</td>"
        rows.append("<tr>" + "".join(cells) + "</tr>")
    named = html.escape(content.title)
    above = f'<p class="title">{named}</p>' if named else ""  # a caption would scroll away with it
    # With tabindex the keyboard scrolls the table.
    region = f'class="wide" role="region" tabindex="0" aria-label="{named or "table"}"'
    wrapping = _class("wrapping" if content.words else "")  # may break its lines on a phone
    return (
        f"{above}<div {region}><table{wrapping}><thead><tr>{head}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div>\n"
    )


def preformatted(text: str) -> str:
    """Return text verbatim, e.g. a file of settings."""
    return f"<pre>{html.escape(text)}</pre>\n"


def png(picture: bytes, description: str) -> str:
    """Return a PNG inside the page.

    Parameters
    ----------
    description : str
        Text for screen readers.
    """
    encoded = base64.b64encode(picture).decode()
    return f'<img alt="{html.escape(description)}" src="data:image/png;base64,{encoded}">\n'


def svg_figure(svg: str, description: str, *, caption: str = "", name: str) -> str:
    """Return an SVG as a figure of the page, its ids made unique by `name`.

    Parameters
    ----------
    svg : str
        A whole SVG file; what comes before its root element is left out.
    """
    root = svg[svg.index("<svg") :].strip()
    own = re.sub(r'(\bid="|xlink:href="#|href="#|url\(#)', rf"\g<1>{name}-", root)
    labelled = own.replace("<svg", f'<svg role="img" aria-label="{html.escape(description)}"', 1)
    below = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{labelled}{below}</figure>\n"


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""
