"""The page kit: style, sections, tables and panels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from tactileforge.pages.figures import CLASSES, marker_of

MINUS = "\N{MINUS SIGN}"
NONE = "\N{EN DASH}"
SPLIT_WORDS = {"val": "validation", "train": "training"}

_CSS = """
:root{color-scheme:light dark;--ink:#1b1f27;--soft:#5a6270;--paper:#fff;--card:#f6f7f9;
--line:#d9dde3;--other:#a8afb9;--shade:#e6e9ef;--good:#00714f;--bad:#b03a00;COLOURS0}
@media(prefers-color-scheme:dark){:root{--ink:#e7eaef;--soft:#a3abb8;--paper:#14171c;--card:#1c2027;
--line:#343b46;--other:#636c79;--shade:#2a303a;--good:#3fd0a0;--bad:#ff9459;COLOURS1}}
*{box-sizing:border-box}
html{scroll-padding-top:3.5rem;-webkit-text-size-adjust:100%}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
section:first-of-type h2{border:0;margin-top:.6rem}
main,header>div,nav>div{max-width:1120px;margin:auto;padding:0 1.1rem}
header{padding-top:1.6rem}
h1{font-size:1.7rem;line-height:1.2;margin:0 0 .3rem}
h2{font-size:1.3rem;margin:2.8rem 0 .4rem;padding-top:1.1rem;border-top:1px solid var(--line)}
h3{font-size:1rem;margin:1.4rem 0 .4rem}
p{margin:.4rem 0;max-width:48rem}
.soft,figcaption{color:var(--soft);font-size:.9rem}
nav{position:sticky;top:0;z-index:9;background:var(--paper);border-bottom:1px solid var(--line);
margin-top:1rem}
nav>div{display:flex;gap:1.3rem;overflow-x:auto;white-space:nowrap;padding-block:.6rem}
a{color:var(--c0)}nav a{text-decoration:none}
dl{display:grid;grid-template-columns:repeat(auto-fit,minmax(max(9rem,22%),1fr));gap:.6rem;
margin:1.1rem 0}
dl div{background:var(--card);border-radius:8px;padding:.55rem .8rem;min-width:0}
dt{color:var(--soft);font-size:.8rem}dd{margin:0;overflow-wrap:anywhere}
ul.verdict{list-style:none;padding:0;margin:.9rem 0}
ul.verdict li{padding:.18rem 0 .18rem 1.7rem;position:relative;max-width:52rem}
ul.verdict li::before{position:absolute;left:.2rem;font-weight:700}
.good::before{content:"\\2713";color:var(--good)}.bad::before{content:"!";color:var(--bad)}
.plain::before{content:"\\00b7";color:var(--soft)}
td.good{color:var(--good)}td.bad{color:var(--bad)}td::before{content:none!important}
.scroll{overflow-x:auto;margin:.9rem 0}
table{border-collapse:collapse;font-size:.93rem;font-variant-numeric:tabular-nums}
th,td{padding:.32rem .8rem;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
th:first-child,.text{text-align:left}
.text,#sources th[scope=row]{white-space:normal;overflow-wrap:anywhere;min-width:9rem}
thead th{color:var(--soft);font-weight:600;vertical-align:bottom}th[scope=row]{font-weight:600}
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,19rem),1fr));
gap:1rem 1.4rem;margin:1rem 0}
.panels.wide{grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr))}
figure{margin:0;min-width:0}figure>b{display:block;font-size:.95rem}
figure>b,h1,h3,li{overflow-wrap:anywhere}
figure>svg{width:100%;height:auto;display:block}
svg *{stroke-linejoin:round}
.legend{list-style:none;display:flex;flex-wrap:wrap;gap:.15rem 1rem;padding:0;margin:.5rem 0;
font-size:.88rem}
.legend svg{width:.8em;height:.8em;margin-right:.35em;vertical-align:-.05em}
.clip{background:var(--card);border-radius:10px;padding:.8rem}
.strip{display:grid;gap:3px;margin:.15rem 0 .5rem}
.strip img{width:100%;height:auto;display:block;border-radius:3px}
.strip-name{font-size:.83rem;color:var(--soft)}
@media(max-width:600px){th,td{padding:.3rem .45rem}main,header>div,nav>div{padding:0 .8rem}}
details{margin:.9rem 0}summary{cursor:pointer}
pre{background:var(--card);border-radius:8px;padding:.8rem 1rem;overflow-x:auto;font-size:.83rem;
line-height:1.4}
footer{color:var(--soft);font-size:.85rem;margin:3rem 0 2rem}
"""
_SHAPES = {
    "o": '<circle cx="5" cy="5" r="4.4"/>',
    "^": '<path d="M5 .6 9.8 9.2H.2z"/>',
    "s": '<path d="M1 1h8v8H1z"/>',
}


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        name: Its anchor.
        title: Plain text.
        body: HTML.
    """

    name: str
    title: str
    body: str


def page(title: str, top: str, sections: Sequence[Section]) -> str:
    """The whole page.

    Args:
        title: Plain text.
        top: HTML between the title and the table of contents.
        sections: In order.
    """
    css = _CSS
    for theme in (0, 1):
        variables = ";".join(f"--c{i}:{colours[theme]}" for i, colours in enumerate(CLASSES))
        css = css.replace(f"COLOURS{theme}", variables)
    links = "".join(f'<a href="#{part.name}">{escape(part.title)}</a>' for part in sections)
    bodies = "\n".join(
        f'<section id="{part.name}"><h2>{escape(part.title)}</h2>\n{part.body}\n</section>'
        for part in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<title>{escape(title)}</title><link rel="icon" href="data:,">'
        f"<style>{css}</style></head>\n"
        f"<body><header><div><h1>{escape(title)}</h1>\n{top}</div></header>\n"
        f'<nav aria-label="Contents"><div>{links}</div></nav>\n<main>{bodies}\n'
        "<footer>Written by tactileforge. This file needs no network.</footer></main></body>"
        "</html>\n"
    )


def table(name: str, head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """A table whose first column names the rows.

    Args:
        name: Its id.
        head: Plain text, as are the rows; a cell may begin with a class (``good|``, ``text|``).
        rows: One sequence a row.
        caption: Plain text, above the table.
    """
    words = f'<p class="soft" id="{name}-note">{escape(caption)}</p>' if caption else ""
    described = f' aria-describedby="{name}-note"' if caption else ""
    top = "".join(_cell(cell, 'th scope="col"') for cell in head)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>{"".join(map(_cell, rest))}</tr>'
        for first, *rest in rows
    )
    return (
        f'{words}<div class="scroll" tabindex="0"><table id="{name}"{described}>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cell(text: str, tag: str = "td") -> str:
    kind, mark, rest = text.partition("|")
    if not mark or kind not in ("good", "bad", "text"):
        kind, rest = "", text
    marked = f' class="{kind}"' if kind else ""
    return f"<{tag}{marked}>{escape(rest)}</{tag[:2]}>"


def paragraph(text: str, soft: bool = False) -> str:
    """Plain text."""
    return f"<p{' class=soft' if soft else ''}>{escape(text)}</p>"


def panel(title: str, drawing: str, caption: str = "") -> str:
    """A drawing with its title, and a line below it; both plain text."""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure><b>{escape(title)}</b>{drawing}{below}</figure>"


def panels(parts: Iterable[str], wide: bool = False) -> str:
    """Drawings side by side, as many as fit."""
    return f'<div class="panels{" wide" if wide else ""}">{"".join(parts)}</div>'


def legend(names: Mapping[int, str], line: str = "", area: str = "") -> str:
    """The legend of a drawing.

    Args:
        names: By the number of the class; -1 is grey.
        line: What a line in the colour of the text stands for.
        area: What a shaded area stands for.
    """
    keys = [
        (_SHAPES[marker_of(i)], f"var(--c{i % len(CLASSES)})" if i >= 0 else "var(--other)", name)
        for i, name in names.items()
    ]
    keys += [('<path d="M0 4h10v2H0z"/>', "currentColor", line)] * bool(line)
    keys += [('<path d="M0 0h10v10H0z"/>', "var(--shade)", area)] * bool(area)
    items = "".join(
        f'<li><svg viewBox="0 0 10 10" aria-hidden="true" fill="{colour}">{shape}</svg>'
        f"{escape(name)}</li>"
        for shape, colour, name in keys
    )
    return f'<ul class="legend">{items}</ul>'


def number(value: float) -> str:
    """Three digits; a dash for what is not a number."""
    return f"{value:.3g}".replace("-", MINUS) if value == value else NONE


def percent(share: float, signed: bool = False) -> str:
    """A share in whole percent; one digit more below ten."""
    value = 100 * share
    if value != value:
        return NONE
    text = f"{value:{'+' if signed else ''}.{1 if abs(value) < 9.95 else 0}f}"
    return f"{text.lstrip('+-') if float(text) == 0 else text} %".replace("-", MINUS)


def duration(seconds: float) -> str:
    """Seconds as people say them.

    Example:
        >>> duration(75), duration(7500), duration(4.2)
        ('1 min 15 s', '2 h 5 min', '4.2 s')
    """
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
