"""report.html: a walk to look at and the results of the whole chain, in one file that opens without a network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hqpipe.report.chain_parts import Chain, Part, Walk, hidden, picture, plain, table, text, wide
from hqpipe.report.chain_sections import SECTIONS, Section
from hqpipe.report.chain_template import page
from hqpipe.report.diagnosis_read import read_files
from hqpipe.report.diagnosis_words import number, size_text

PAGE = "report.html"
_KEY = 12  # digits of a key that are shown, as in messages of the command line


def write_report(folder: Path, chain: Chain) -> Path:
    """Write report.html; the same chain gives the same bytes.

    Raises:
        UsageError: a result's record or file does not hold what its section shows.
    """
    parts = [_top(chain), *(_checked_section(section, chain) for section in SECTIONS), _sources(chain)]
    path = folder / PAGE
    path.write_text(page(f"{chain.walk.robot}: walk and results", parts), encoding="utf-8")
    return path


def _top(chain: Chain) -> str:
    """Film, headline numbers, notes, and the figure of the walk."""
    walk = chain.walk
    first, last = walk.shown
    slow = "" if walk.play == 1.0 else f", shown at {walk.play:g} times its speed"
    alt = f"{walk.robot} walking on the plant at {walk.speed:.2f} m/s"
    notes = "".join(f'<p class="missing">{text(note)}</p>' for note in chain.notes)
    return (
        f"<p class=soft>{text(walk.robot)}</p>"
        f"<h1>{_title(walk)}</h1>"
        f"<figure class=film>{picture(walk.film, alt)}<figcaption>{text(_order(walk))}; "
        f"seconds {first:.1f} to {last:.1f} of a walk on the reference plant{slow}. "
        f"<span class=from>seed {walk.seed}, plant {text(_plant(walk))}</span></figcaption></figure>"
        f"<dl class=tiles>{''.join(_tile(*tile) for tile in _tiles(chain))}</dl>{notes}"
        f"<section><h2>The walk</h2><figure>{wide(walk.figure, 'speed, foot contacts, torques, pressure, posture')}"
        "<figcaption>Torques are the largest of their kind of joint, as a share of its limit; bars are feet on the "
        "ground.</figcaption></figure></section>"
    )


def _title(walk: Walk) -> str:
    speed = f"{walk.speed:.2f} m/s where {walk.order[0]:.2f} is ordered"
    if walk.fall_time is None:
        return f"The exported policy walks at {speed}."
    return f"The exported policy fell after {walk.fall_time:.1f} s, having walked at {speed}."


def _order(walk: Walk) -> str:
    vx, vy, wz = walk.order
    words = [f"Ordered: {vx:g} m/s ahead"]
    words += [f"{abs(vy):g} m/s to the {'left' if vy > 0.0 else 'right'}"] if vy else []
    words.append("heading held" if wz is None else f"turning {wz:g} rad/s")
    return ", ".join(words)


def _plant(walk: Walk) -> str:
    return json.dumps(walk.plant, ensure_ascii=False) if walk.plant else "as designed"


def _tiles(chain: Chain) -> list[tuple[str, str, str]]:
    """(name, number, note) of the five headline numbers."""
    walk, checked, gap = chain.walk, chain.parts.get("validation"), chain.parts.get("diagnosis")
    tiles = [
        (
            "speed on the plant",
            f"{walk.speed:.2f} <small>m/s</small>",
            f"ordered {walk.order[0]:.2f}, in this walk of {walk.seconds:.0f} s",
        )
    ]
    if checked is None or checked.record is None:
        tiles += [_unknown(chain, "validation", "falls in validation")]
    else:
        rows = checked.told("scenarios")
        falls = f"{sum(row['falls'] for row in rows)} <small>of {sum(row['walks'] for row in rows)}</small>"
        kinds = f"{len(rows)} kind{'s' if len(rows) > 1 else ''}"
        tiles.append(("falls in validation", falls, f"walks of {kinds} on the plant"))
    tiles.append(_unknown(chain, "diagnosis", "model error") if gap is None else _gap(gap))
    if checked is None or checked.record is None:
        tiles += [_unknown(chain, "validation", "latency")]
    else:
        slow = f"median call of the policy; 99 in 100 take less than {number(checked.told('latency', 'p99_us'))}"
        tiles.append(("latency", f"{number(checked.told('latency', 'median_us'))} <small>µs</small>", slow))
    return [*tiles, _run_time(chain)]


def _gap(part: Part) -> tuple[str, str, str]:
    gap = read_files(part.folder).content["gap"]
    if gap is None:
        return "model error", "–", "these logs cannot tell, says the diagnosis"
    note = f"before and after the diagnosis, free-running; noise {text(size_text(gap, 'noise_floor'))}"
    return "model error", f"{text(size_text(gap, 'before'))} → {text(size_text(gap, 'after'))}", note


def _unknown(chain: Chain, artifact: str, name: str) -> tuple[str, str, str]:
    return name, "–", f"<code>{text(chain.commands[artifact])}</code> tells"


def _run_time(chain: Chain) -> tuple[str, str, str]:
    times = [part.record["provenance"]["wall_time_s"] for part in chain.parts.values() if part.record]
    if not times:
        return "run time", "–", "no result has a manifest"
    minutes, seconds = divmod(round(sum(times)), 60)
    many = f"{len(times)} result{'s' if len(times) > 1 else ''}"
    return "run time", f"{minutes} <small>min</small> {seconds} <small>s</small>", f"of all that made the {many} shown"


def _tile(name: str, value: str, note: str) -> str:
    return f"<div><dt>{name}</dt><dd>{value}</dd><p>{note}</p></div>"


def _checked_section(section: Section, chain: Chain) -> str:
    """`_section`; a record whose metrics are of another form than this version writes is an error that names it."""
    try:
        return _section(section, chain)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        part = chain.parts.get(section.artifact)
        if part is None:
            raise
        raise part.wrong(
            f"its metrics are not of the form that this version shows ({type(error).__name__}: {error})"
        ) from error


def _section(section: Section, chain: Chain) -> str:
    """Title, headline, content and origin of a result, or how to get it."""
    part = chain.parts.get(section.artifact)
    if part is None:
        command, option = (text(names[section.artifact]) for names in (chain.commands, chain.options))
        body = (
            f'<p class="missing">Not made, or not given: <code>{command}</code> makes artifacts/{text(section.artifact)}, '
            f"<code>hqpipe report</code> then shows it; <code>{option} DIR</code> names a folder instead.</p>"
        )
        return f"<section><h2>{text(section.title)}</h2>{body}</section>"
    lead = "" if part.record is None or not section.headline else f"<p class=lead>{text(_headline(part))}</p>"
    return f"<section><h2>{text(section.title)}</h2>{lead}{section.draw(part, chain)}{_origin(part)}</section>"


def _headline(part: Part) -> str:
    return str(part.record["metrics"].get("headline", ""))


def _origin(part: Part) -> str:
    """The line below a section that says which result it shows."""
    if part.record is None:
        return f'<p class="from">{text(part.shown)}: a folder without a manifest, so that only its files are shown</p>'
    recipe, made = part.record["recipe"], part.record["provenance"]
    words = [
        part.shown,
        f"key {part.record['key'][:_KEY]}",
        f"seed {recipe['seed']}",
        f"profile {made['profile']}",
        f"{made['wall_time_s']:.0f} s",
        f"hqpipe {made['hqpipe']}",
    ]
    return f'<p class="from">{text(" · ".join(words))}</p>'


def _sources(chain: Chain) -> str:
    """Key, seed, profile and versions of every result."""
    known = [part for part in chain.parts.values() if part.record]
    rows = [_source(part) for part in known]
    head = ("result", "key", "stage", "seed", "profile", "made", "commit", "s")
    body = table(head, rows, words=7) if rows else '<p class="missing">No result has a manifest.</p>'
    details = "".join(
        hidden(f"Parameters of {part.artifact}", plain(part.record["recipe"]["params"])) for part in known
    )
    return f"<section><h2>Where it comes from</h2>{body}{_versions(known)}{details}</section>"


def _source(part: Part) -> tuple[str, ...]:
    recipe, made = part.record["recipe"], part.record["provenance"]
    git = made["git"]
    commit = "–" if git is None else git["commit"][:_KEY] + (" + changes" if git["dirty"] else "")
    cells = (
        part.artifact,
        part.record["key"][:_KEY],
        f"{recipe['stage']} v{recipe['version']}",
        recipe["seed"],
        made["profile"],
        made["created"],
        commit,
        f"{made['wall_time_s']:.0f}",
    )
    return tuple(text(cell) for cell in cells)


def _versions(known: list[Part]) -> str:
    """Versions and machines, each with the results that it made; one row where all were made alike."""
    makers: dict[str, list[str]] = {}
    for part in known:
        made: dict[str, Any] = part.record["provenance"]
        packages = [f"{name} {version}" for name, version in made["packages"].items() if version]
        machine = f"{made['machine']['cpu']}, {made['machine']['cores']} cores, {made['machine']['system']}"
        words = [f"hqpipe {made['hqpipe']}", f"Python {made['python']}", *packages, machine]
        makers.setdefault(", ".join(words), []).append(part.artifact)
    return "".join(
        f'<p class="from">{text(", ".join(artifacts) if len(makers) > 1 else "all")}: {text(words)}</p>'
        for words, artifacts in makers.items()
    )
