"""Source of what is found sample by sample along a trial: states before each window."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hqpipe.machine.compose.source import Source, Straight, constants, present
from hqpipe.machine.compose.wiring import STATE, Chain, Link, Ref

if TYPE_CHECKING:
    from hqpipe.machine.compose.windows import Arrays


def _fetch(source: Source, arrays: Arrays, names: list[str], k: str) -> None:
    """Signals along the log at a sample into variables."""
    for name in names:
        when = arrays.when(name)
        given = f"a_{name}[{k}]"
        if when is not None:
            given = f"a_{name}[{k}] if on_{name} else {arrays.neutral(name)}"
        source.add(f"{'m_' * (name in arrays.chain.shared)}{name} = {given}")


def write_follow(source: Source, chain: Chain, arrays: Arrays) -> None:
    """`follow`: the torque of the base and the states behind it at the start of each window.

    They hang on what went before, so they are followed along with the logged torque.
    """
    names = arrays.needed
    states = [out.name for x in (*chain.core, *chain.behind) for out in x.outs if out.kind == STATE]
    effort = [x for x in chain.behind if "effort" in x.writes and x.undo]
    carried = chain.when(*states, *(["effort"] if effort else []))
    says = "Torque of the base and states behind it at the start of each window, into the first lines."
    with source.function("follow", f"p, s, w, {', '.join(f'a_{n}' for n in names)}", says):
        constants(source, chain)
        for name in names:
            if (when := arrays.when(name)) is not None:
                source.add(f"on_{name} = {present(when)}")
        source.add(*(f"m_{name} = 0.0" for name in states))
        if carried:
            with source.under(f"if {present(carried)}:"):
                _before_windows(source, chain, arrays, states, [*effort][:1])
        with source.under("for i in range(s.first.shape[0]):"):
            source.add("k = s.first[i]")
            _fetch(source, arrays, names, "k")
            expected = "0.0"
            if carried:
                with source.under(f"if {present(carried)}:"):
                    source.add(*(f"m_{name} = w.states[{1 + j}, i]" for j, name in enumerate(states)))
                expected = f"w.states[0, i] if {present(carried)} else 0.0"
            code = Straight(source, chain, names)
            code.unmeasured("s.target[0, i]")
            code.unloaded()
            source.add(f"expected = {expected}")
            code.rewound()
            source.add("w.lines[0, i] = wound", *(f"w.lines[{1 + j}, i] = m_{name}" for j, name in enumerate(states)))


def _before_windows(source: Source, chain: Chain, arrays: Arrays, states: list[str], slack: list[Link]) -> None:
    """The states along each trial up to the start of each window, from where the last window left them, or from where nothing
    that lies further back is remembered."""
    source.add("trial, at = -1, 0")
    with source.under("for i in range(s.first.shape[0]):"):
        source.add(
            "last = s.first[i]",
            "now = np.searchsorted(s.bounds, last, side='right') - 1",
            "begin = at if now == trial and at <= last else s.bounds[now]",
        )
        _skip_forgotten(source, chain, arrays, states, slack)
        with source.under("if now != trial or begin != at:"):
            source.add("k = begin", *(f"m_{name} = 0.0" for name in states))
            _fetch(source, arrays, arrays.needed, "k")
            code = Straight(source, chain, arrays.needed)
            code.unmeasured("s.effort[k]")
            code.unloaded()
            source.add("expected = 0.0")
            code.rewound()
            code.started(chain.core)
        _advance(source, chain, arrays, states, bool(slack))
        source.add("trial, at = now, last", "w.states[0, i] = wound")
        source.add(*(f"w.states[{1 + j}, i] = m_{name}" for j, name in enumerate(states)))


def _skip_forgotten(source: Source, chain: Chain, arrays: Arrays, states: list[str], slack: list[Link]) -> None:
    """Begin later, if every state that is there forgets where it began."""
    moved_by = list(dict.fromkeys(chain.moved_by[name] for name in states if name in chain.moved_by))
    if not moved_by:
        return
    there = [f"on_{name}" for name in moved_by if arrays.when(name) is not None]
    lasting = [x for x in (*chain.core, *chain.behind) for out in x.outs if _lasts(chain, out)]
    there += [f"not ({present(link.when)})" for link in (*lasting, *slack)]
    begins = [f"remembered(a_{name}, begin, last)" for name in moved_by]
    with source.under(f"if {' and '.join(there) or True}:"):
        source.add(f"begin = min({', '.join(begins)}, last)")


def _lasts(chain: Chain, out: Ref) -> bool:
    """Whether what a link writes is a state that does not forget where it began."""
    return out.kind == STATE and out.name not in chain.moved_by


def _advance(source: Source, chain: Chain, arrays: Arrays, states: list[str], slack: bool) -> None:
    """From `begin` to `last`, sample by sample."""
    names = arrays.needed
    with source.under("for k in range(begin, last):"):
        _fetch(source, arrays, names, "k")
        code = Straight(source, chain, [*names, "wound"])
        source.add("before = wound")
        code.known.add("before")
        code.behind({"inner"}, True)
        code.behind({"lost"}, True)
        code.behind({"effort"}, True)
        for link in chain.core:
            code.link(link)
        code.law("wound")
        code.behind({"inner", "grip", "turned"}, True)
        for link in chain.behind:
            if link.writes <= set(states) and "turned" not in link.writes:
                code.link(link)
        late = sorted(
            {n for x in chain.behind if x.writes & {"lost", "effort", "measured"} for n in x.reads} & set(names)
        )
        _fetch(source, arrays, late, "k + 1")
        code.unmeasured("s.effort[k + 1]")
        if not slack:
            code.unloaded()
        else:
            link = next(x for x in chain.behind if "effort" in x.writes)
            with source.under(f"if {present(link.when)}:"):
                code.behind({"lost"}, True)
                source.add("expected = wound")
                code.rewound()
            with source.under("else:"):
                code.unloaded()
