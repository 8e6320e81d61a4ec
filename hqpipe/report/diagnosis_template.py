"""The frame of the diagnosis page: style, script and the plotly.js library, all inside the one file."""

from __future__ import annotations

import base64
import functools
import gzip
import html
import json
from collections.abc import Mapping, Sequence
from typing import Any

_STYLE = """
:root { --ink: #222; --soft: #555; --line: #dcdcdc; --wash: #f6f6f4; --before: #D55E00; --after: #0072B2; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); -webkit-text-size-adjust: 100%;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
main { max-width: 1160px; margin: 0 auto; padding: 20px 20px 60px; }
h1 { font-size: clamp(22px, 3.4vw, 32px); line-height: 1.25; margin: 10px 0 18px; text-wrap: balance; }
h2 { font-size: 20px; margin: 44px 0 6px; padding-top: 14px; border-top: 1px solid var(--line); }
h3 { font-size: 16px; margin: 0; }
p { margin: 6px 0 12px; max-width: 92ch; }
.soft, .legend, caption { color: var(--soft); font-size: 14px; }
code, .mono { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
.top { display: flex; flex-wrap: wrap; gap: 10px; align-items: center; color: var(--soft); font-size: 14px; }
.badge { font-weight: 600; border-radius: 99px; padding: 3px 14px; color: #fff; background: #555; font-size: 15px; }
.badge.explained { background: #0072B2; }
.badge.partly_explained { background: #56B4E9; color: #111; }
.badge.unknown { background: #B34700; }
.badge.no_gap { background: #222; }
.badge.not_identifiable { background: #fff; color: #222; box-shadow: inset 0 0 0 2px #222; }
.numbers { display: grid; grid-template-columns: repeat(auto-fit, minmax(220px, 1fr)); gap: 12px; margin: 0; }
.numbers div { background: var(--wash); border-radius: 10px; padding: 12px 16px; }
.numbers dt { color: var(--soft); font-size: 14px; }
.numbers dd { margin: 0; font-size: 26px; font-weight: 650; font-variant-numeric: tabular-nums; line-height: 1.3; }
.numbers dd small { font-size: 15px; font-weight: 400; color: var(--soft); }
.numbers p { margin: 2px 0 0; font-size: 13px; color: var(--soft); line-height: 1.4; }
.before { color: var(--before); } .after { color: var(--after); }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(330px, 100%), 1fr)); gap: 14px;
  margin-top: 14px; }
.card { border: 1px solid var(--line); border-radius: 10px; padding: 14px 16px; break-inside: avoid; }
.card p { margin: 4px 0 8px; }
.card .do { border-left: 3px solid var(--after); padding-left: 10px; }
.card .but { border-left: 3px solid #E69F00; padding-left: 10px; }
.chips { display: flex; flex-wrap: wrap; gap: 4px; margin: 6px 0 8px; }
.chip { background: var(--wash); border-radius: 5px; padding: 0 8px; font-size: 14px; overflow-wrap: anywhere; }
.bar { height: 8px; background: #ececec; border-radius: 4px; overflow: hidden; margin: 6px 0; }
.bar i { display: block; height: 100%; background: #56B4E9; }
.bar.left i { background: var(--before); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
.plain { width: 100%; font-size: 14px; }
.plain th, .plain td { text-align: left; padding: 5px 10px 5px 0; border-bottom: 1px solid #ececec; vertical-align: top;
  overflow-wrap: anywhere; }
.plain thead th { white-space: nowrap; color: var(--soft); font-weight: 600; }
.plain .n { text-align: right; white-space: nowrap; }
.plain button { all: unset; cursor: pointer; } .plain button:focus-visible { outline: 2px solid var(--after); }
.plain th[aria-sort=ascending] button::after { content: " ▲"; }
.plain th[aria-sort=descending] button::after { content: " ▼"; }
.card .plain td, .card .plain th { padding: 3px 8px 3px 0; }
.scroll { overflow-x: auto; max-width: 100%; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(500px, 100%), 1fr)); gap: 24px; }
.pair > * { min-width: 0; }
.heat { font-size: 11px; border-spacing: 0; }
.heat td { min-width: 21px; height: 21px; padding: 0 1px; text-align: center; border: 1px solid #efefef; }
.pair > :only-child .heat td { min-width: 32px; height: 24px; font-size: 12px; }
.heat td.absent { background: repeating-linear-gradient(45deg, #fff 0 3px, #e6e6e6 3px 4px); }
.heat .first { border-left: 7px solid #fff; }
.heat td.named { outline: 2px solid #222; outline-offset: -2px; }
.heat th { font-weight: 400; }
.heat tbody th { text-align: right; padding-right: 4px; position: sticky; left: 0; background: #fff; font-size: 12px;
  max-width: 150px; white-space: nowrap; overflow: hidden; text-overflow: ellipsis; }
.heat .family { color: var(--soft); font-size: 11px; text-align: left; padding: 0 0 2px 2px; overflow: hidden; }
.heat .regime { height: 112px; vertical-align: bottom; padding: 0; }
.heat .regime span { writing-mode: vertical-rl; transform: rotate(180deg); white-space: nowrap; font-size: 12px; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(340px, 100%), 1fr)); gap: 18px 14px; }
.grid figure { margin: 0; min-width: 0; break-inside: avoid; }
figcaption { font-size: 14px; } figcaption span { color: var(--soft); }
.chart { width: 100%; overflow: hidden; }
.key::before { content: ""; display: inline-block; width: 22px; margin-right: 6px; vertical-align: middle;
  border-top: 3px solid currentColor; }
.key.dot::before { border-top-style: dotted; } .key.thin::before { width: 0; height: 14px; border-top: 0;
  border-left: 2px solid #bbb; }
.legend { display: flex; flex-wrap: wrap; gap: 2px 20px; margin: 4px 0 10px; }
.next p { margin: 6px 0; }
.next { background: var(--wash); border-left: 4px solid var(--after); border-radius: 4px; padding: 10px 16px; }
ul { padding-left: 20px; margin: 6px 0; max-width: 80ch; } li { margin: 4px 0; }
summary { cursor: pointer; color: var(--after); margin: 10px 0; }
.made th { width: 150px; color: var(--soft); font-weight: 400; white-space: nowrap; }
@media (max-width: 520px) { main { padding: 12px 12px 40px; } .made th { width: 96px; white-space: normal; } }
@media print {
  @page { margin: 14mm; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  main { max-width: none; padding: 0; } body { font-size: 13px; }
  h2 { break-after: avoid; margin-top: 26px; } .pair { grid-template-columns: 1fr; }
  .pair > div { break-inside: avoid; }
  .grid { grid-template-columns: 1fr 1fr; } .scroll { overflow: visible; } .noprint { display: none; }
}
"""

# Charts are drawn one after another, so that the page can be read while it fills; those in a closed list when it is
# opened. On paper they get the width of the paper, for plotly does not see a print layout.
_SCRIPT = """
(async () => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const charts = [...document.querySelectorAll(".chart")];
  const say = (text) => charts.forEach((node) => { node.textContent = text; });
  document.querySelectorAll("th button").forEach((button) => button.addEventListener("click", () => {
    const head = button.closest("th"), body = head.closest("table").tBodies[0];
    const down = head.getAttribute("aria-sort") === "ascending";
    head.parentNode.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const value = (row) => row.cells[head.cellIndex].dataset.value ?? row.cells[head.cellIndex].textContent;
    const order = (a, b) => value(a).localeCompare(value(b), undefined, { numeric: false });
    const numeric = (a, b) => Number(value(a)) - Number(value(b));
    const rows = [...body.rows].sort(head.classList.contains("n") ? numeric : order);
    body.append(...(down ? rows.reverse() : rows));
  }));
  if (!charts.length) return;
  if (!("DecompressionStream" in window)) {
    say("This browser is older than 2023 and cannot draw the charts; the tables hold the numbers.");
    return;
  }
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const library = document.createElement("script");
  library.textContent = await new Response(stream).text();
  document.head.append(library);
  const draw = async (node) => {
    if (node.dataset.drawn) return;
    node.dataset.drawn = "yes";
    const figure = figures[node.dataset.figure];
    await Plotly.newPlot(node, figure.data, figure.layout, { responsive: true, displayModeBar: false });
  };
  const wide = matchMedia("(hover: hover)").matches;
  for (const figure of Object.values(figures)) if (wide && figure.zoom) figure.layout.dragmode = "zoom";
  for (const details of document.querySelectorAll("details"))
    details.addEventListener("toggle", () => details.querySelectorAll(".chart").forEach(draw));
  addEventListener("beforeprint", () => charts.filter((node) => node.dataset.drawn).forEach((node) =>
    Plotly.relayout(node, { width: node.closest(".grid") ? 330 : 680 })));
  addEventListener("afterprint", () => charts.filter((node) => node.dataset.drawn).forEach((node) =>
    Plotly.relayout(node, { width: null, autosize: true })));
  for (const node of charts) {
    if (node.closest("details:not([open])")) continue;
    await draw(node);
    await new Promise((next) => setTimeout(next));
  }
})();
"""


def page(title: str, sections: Sequence[str], figures: Mapping[str, Any]) -> str:
    """A whole HTML document that needs nothing from outside.

    Args:
        title: plain text, escaped here.
        sections: HTML.
        figures: name → plotly.js figure; an element with ``data-figure="name"`` shows it. Without any, the library
            stays out of the file.
    """
    # "<" would let a name in the data close the element that holds it
    data = json.dumps(figures, ensure_ascii=False, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{html.escape(title)}</title>",
            f"<style>{_STYLE}</style></head><body><main>",
            *(section for section in sections if section),
            "</main>",
            f'<script type="application/json" id="figures">{data}</script>',
            _library() if figures else "",
            f"<script>{_SCRIPT}</script>",
            "</body></html>",
            "",
        ]
    )


@functools.cache
def _library() -> str:
    """plotly.js as gzip in base64: less than half its size, and no text in it can end the script element."""
    from plotly.offline import get_plotlyjs

    packed = base64.b64encode(gzip.compress(get_plotlyjs().encode("utf-8"), mtime=0)).decode("ascii")
    return f'<!-- plotly.js, MIT licence, gzip in base64 -->\n<script type="text/plain" id="plotly">{packed}</script>'
