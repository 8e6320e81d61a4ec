"""Source of what is found sample by sample along a trial: states before each window, and the start of states that the whole
trial tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hqpipe.machine.compose.source import Source, Straight, call, constants, constants_of, present, scalar, started
from hqpipe.machine.compose.wiring import SIGNAL, STATE, Chain, Link, Ref

if TYPE_CHECKING:
    from hqpipe.machine.compose.windows import Arrays

NO_LIMIT = 1e299  # of a state: none of a machine is as large


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
        code.behind({"inner"}, True)
        source.add("before = inner")
        code.known.add("before")
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


def write_balances(source: Source, chain: Chain, arrays: Arrays) -> None:
    """`balance_<state>` for each state whose start only the whole trial tells."""
    for link in chain.ahead:
        if link.balance:
            _missing(source, chain, arrays, link)
            _balance(source, chain, arrays, link)


def balance_arrays(chain: Chain, arrays: Arrays, link) -> list[str]:
    """Signals along the log that the search for a start reads."""
    at = chain.ahead.index(link)
    own = {n for x in chain.ahead[at + 1 :] for n in x.writes} - {"opening"}
    calls = [x.call for x in (*chain.ahead[at:], *chain.core) if x.call] + [
        chain.law,
        chain.plain,
        link.starts[link.balance][1],
    ]
    calls += [x.undo for x in chain.behind if "measured" in x.writes and x.undo]
    read = {ref.name for made in calls for ref in made.args if ref.kind in (SIGNAL, STATE)} - {link.balance}
    states = {out.name for out in link.outs if out.kind == STATE}
    return sorted(((read & arrays.along) - own - states) | {"opening", "error"})


def _head(chain: Chain, arrays: Arrays, link) -> tuple[list[str], str]:
    names = balance_arrays(chain, arrays, link)
    return names, ", ".join(f"a_{name}" for name in names)


def _missing(source: Source, chain: Chain, arrays: Arrays, link) -> None:
    state, at = link.balance, chain.ahead.index(link)
    names, given = _head(chain, arrays, link)
    says = "Torque, N·m, that a start leaves open by the end of a trial, and over how many samples."
    with source.function(f"missing_{state}", f"p, s, first, last, start, most, stride, {given}", says):
        constants(source, chain)
        source.add("p = p.copy()", f"p[{chain.column('setting', 'sample_time')}] *= stride")
        for name in names:
            if (when := arrays.when(name)) is not None:
                source.add(f"on_{name} = {present(when)}")
        links = [x for x in chain.ahead[at:] if x.call is not None and not x.only_delays]
        source.add(f"m_{state} = start", "total, begun, end = 0.0, 0.0, first")
        source.add(*(f"m_{name} = 0.0" for x in links for name in x.starts if name != state))
        source.add(*(f"m_{name} = 0.0" for x in chain.core for name in x.starts))
        with source.under("for k in range(first, last - stride + 1, stride):"):
            _fetch(source, arrays, names, "k")
            code = Straight(source, chain, names)
            code.unmeasured("s.effort[k]")
            source.add("begun = behind if k == first else begun", "inner, effort, wound = behind, behind, behind")
            code.known |= {"inner", "effort", "wound"}
            for x in links:
                if own := {name: start for name, start in x.starts.items() if name != state}:
                    code.needs_of(x.call)
                    with source.under("if k == first:"):
                        source.add(*(f"m_{name} = {started(source, start, scalar)}" for name, start in own.items()))
                code.link(x)
            code.started(chain.core, "k == first")
            for x in chain.core:
                code.link(x)
            code.law("following")
            source.add("total += stride * (following - behind)", "end = k + stride")
            with source.under(f"if abs(m_{state}) >= most and k - first >= s.steps:"):
                source.add("break")
        _fetch(source, arrays, names, "end")
        code = Straight(source, chain, names)
        code.unmeasured("s.effort[end]")
        source.add("return behind - begun - total, end - first")


def _balance(source: Source, chain: Chain, arrays: Arrays, link) -> None:
    state = link.balance
    limit, known = link.starts[state]
    names, given = _head(chain, arrays, link)
    held = chain.column("setting", "held")
    says = "What a state is at the start of a trial, so that the torques of the law add up to the logged ones."
    with source.function(f"balance_{state}", f"p, s, first, last, {given}", says):
        constants(source, chain, only=constants_of(chain, [limit, known]))
        with source.under(f"if p[{held}] >= 0.0 and s.time[first] == 0.0:"):
            source.add("k = first")
            _fetch(source, arrays, [n for n in names if n in {r.name for r in known.args}], "k")
            source.add(f"return {call(source, known, scalar)}")
        dt = f"p[{chain.column('setting', 'sample_time')}]"
        source.add(
            f"most = {call(source, limit, scalar)}",
            "start, gain = 0.0, 0.0",
            f"rough = max(1, min(int(ROUGH / {dt}), (last - first) // FEWEST))",
        )
        with source.under("for stride in (rough, 1):"):
            source.add("low, high, before, left = -most, most, start, 0.0")
            with source.under("for _ in range(PASSES):"):
                source.add(
                    f"missing, samples = missing_{state}(p, s, first, last, start, most, stride, {given})",
                    "low, high = (start, high) if missing > 0.0 else (low, start)",
                    "doubt = 1.0  # of the gain: what a start is worth; at first all of it, then as the last two tell",
                )
                with source.under("if gain == 0.0:"):
                    source.add(f"gain = max(p[{chain.gain}] * samples, 1e-300)")
                with source.under("elif start != before:"):
                    source.add("told = (left - missing) / (start - before)")
                    with source.under(f"if told > 0.0 or most < {NO_LIMIT}:"):
                        source.add("last_gain, gain = gain, max(told, 1e-300)")
                        source.add("doubt = min(abs(gain / last_gain - 1.0), 1.0)")
                    with source.under(
                        "else:  # rounding: where there is no limit, more of a start is always worth more"
                    ):
                        source.add("doubt = 0.0")
                source.add("before, left, wanted = start, missing, start + missing / gain")
                with source.under("if wanted < low or wanted > high:  # the limit takes from what the start is worth"):
                    source.add("wanted, doubt = 0.5 * (low + high), 1.0")
                source.add("close = doubt * abs(wanted - start) < CLOSE * abs(wanted)", "start = wanted")
                with source.under("if close:"):
                    source.add("break")
        source.add("return start")
