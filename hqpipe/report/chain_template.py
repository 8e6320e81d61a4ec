"""The frame of the report of a whole chain: one column, light or dark as the reader has it, on paper and on a phone."""

from __future__ import annotations

import html
from collections.abc import Sequence

_STYLE = """
:root { color-scheme: light dark; --ink: #222; --soft: #5f6368; --line: #dedede; --wash: #f5f5f3; --back: #fff;
  --accent: #0072B2; --bad: #B34700; --ok: #00694c; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e6; --soft: #a3a7ab; --line: #3a3d40; --wash: #24272a;
  --back: #17191b; --accent: #56B4E9; --bad: #ff9a5c; --ok: #4fd1a5; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink); -webkit-text-size-adjust: 100%;
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
main { max-width: 860px; margin: 0 auto; padding: 24px 20px 72px; }
h1 { font-size: clamp(22px, 4vw, 32px); line-height: 1.25; margin: 0 0 18px; text-wrap: balance; }
h2 { font-size: 21px; margin: 52px 0 10px; padding-top: 18px; border-top: 1px solid var(--line); }
p { margin: 8px 0 14px; }
a { color: var(--accent); }
.soft, figcaption { color: var(--soft); font-size: 14px; }
.lead { font-size: 17px; }
.from { color: var(--soft); font-size: 12.5px; overflow-wrap: anywhere; }
code, pre { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, monospace; }
pre { overflow-x: auto; background: var(--wash); padding: 12px; border-radius: 8px; }
figure { margin: 18px 0; }
figure img { display: block; width: 100%; height: auto; background: #fff; border-radius: 10px; }
figure:not(.film) img { padding: 8px; border: 1px solid var(--line); }
.wide { overflow-x: auto; }
figcaption { margin-top: 6px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 10px; margin: 20px 0; }
.tiles div { background: var(--wash); border-radius: 10px; padding: 12px 14px; }
.tiles dt { color: var(--soft); font-size: 13.5px; }
.tiles dd { margin: 0; font-size: 20px; white-space: nowrap; font-weight: 650; line-height: 1.35;
  font-variant-numeric: tabular-nums; }
.tiles small { font-size: 14px; font-weight: 400; color: var(--soft); }
.tiles p { margin: 2px 0 0; font-size: 12.5px; line-height: 1.4; color: var(--soft); }
.missing { background: var(--wash); border-left: 4px solid #E69F00; border-radius: 4px; padding: 10px 14px; }
.ok { color: var(--ok); } .bad { color: var(--bad); }
.scroll { overflow-x: auto; margin: 12px 0; }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: 6px 14px 6px 0; border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 600; }
.n { text-align: right; white-space: nowrap; } .n:last-child { padding-right: 0; }
details { margin: 6px 0; } summary { cursor: pointer; color: var(--accent); }
@media (max-width: 520px) { main { padding: 14px 14px 48px; } .wide img { width: 680px; }
  .tiles { grid-template-columns: 1fr 1fr; } }
@media print { main { max-width: none; padding: 0; } figure, table { break-inside: avoid; } h2 { break-after: avoid; } }
"""


def page(title: str, sections: Sequence[str]) -> str:
    """A whole HTML document that needs nothing from outside.

    Args:
        title: plain text, escaped here.
        sections: HTML.
    """
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{html.escape(title)}</title>",
            f"<style>{_STYLE}</style></head><body><main>",
            *(section for section in sections if section),
            "</main></body></html>",
            "",
        ]
    )
