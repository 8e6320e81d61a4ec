"""diagnosis.html: a diagnosis to look at, in one file that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hqpipe.report import diagnosis_sections as sections
from hqpipe.report.diagnosis_advice import Explained
from hqpipe.report.diagnosis_charts import Figure, trace_chart, waterfall
from hqpipe.report.diagnosis_read import DiagnosisFiles, read_files
from hqpipe.report.diagnosis_template import page

PAGE = "diagnosis.html"


def write_page(
    folder: Path,
    *,
    provenance: Mapping[str, str] | None = None,
    effects: Mapping[str, Explained] | None = None,
) -> Path:
    """Write diagnosis.html beside the files of a diagnosis; the same files give the same bytes.

    Args:
        folder: holds diagnosis.json, and residuals.csv and traces.json as far as they were made; a section whose
            file is missing says so.
        effects: name → effects that say themselves what they are and what can be done about them.
        provenance: further rows of the table "how the numbers were made", such as the seed or the command.

    Raises:
        UsageError: there is no diagnosis.json, or a file is not what its name says.
    """
    files = read_files(folder)
    content = files.content
    parts = [
        sections.verdict(content),
        sections.causes(content, effects or {}),
        sections.where(files),
        sections.traces(files),
        sections.remains(content),
        sections.considered(content),
        sections.next_step(files),
        sections.left_out(content),
        sections.warnings(content),
        sections.made(content, provenance or {}),
    ]
    path = folder / PAGE
    path.write_text(page(f"Diagnosis of {sections.log_name(content)}", parts, _figures(files)), encoding="utf-8")
    return path


def _figures(files: DiagnosisFiles) -> dict[str, Figure]:
    """Name → chart, in the order of the page."""
    if files.content["gap"] is None:
        return {}
    mode = files.content["logs"]["control_mode"]
    figures = {"waterfall": waterfall(files.content)}
    for index, trace in sections.by_share(files):
        figures[f"trace{index}"] = trace_chart(trace, mode) | {"zoom": True}
    return figures
