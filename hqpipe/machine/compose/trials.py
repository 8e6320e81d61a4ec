"""Source of what is found sample by sample along a trial: states before each window.

Each sample hangs on the one before, so a processor that follows one stretch of a log mostly waits for the last result. It
follows several side by side in the same time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hqpipe.machine.compose.source import Source, Straight, constants, present
from hqpipe.machine.compose.wiring import STATE, Chain, Link, Ref

if TYPE_CHECKING:
    from hqpipe.machine.compose.windows import Arrays

STRETCHES = 4  # followed side by side: measured; more gained nothing


def write_follow(source: Source, chain: Chain, arrays: Arrays) -> None:
    """`follow`: the torque of the base and the states behind it at the start of each window.

    They hang on what went before, so they are followed along with the logged torque.
    """
    names = arrays.needed
    following = _Following(source, chain, arrays)
    states, carried = following.states, following.carried
    says = "Torque of the base and states behind it at the start of each window, into the first lines."
    with source.function("follow", f"row, s, w, {', '.join(f'a_{n}' for n in names)}", says):
        # Numbers of its own, which nothing that is written into arrays can change.
        source.add(f"p = ({', '.join(f'row[{i}]' for i in range(len(chain.fields)))},)")
        constants(source, chain)
        for name in names:
            if (when := arrays.when(name)) is not None:
                source.add(f"on_{name} = {present(when)}")
        source.add(*(f"m_{name} = 0.0" for name in states))
        if carried:
            with source.under(f"if {present(carried)}:"):
                following.write()
        with source.under("for i in range(s.first.shape[0]):"):
            source.add("k = s.first[i]")
            following.fetch(names, "k")
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


class _Following:
    """Source of the states along the trials up to the start of each window, from where the last window left them, or from where
    nothing that lies further back is remembered.

    Attributes:
        states: names. slack: the links that torque has to get through, one at most. carried: columns of which one is not 0
            where there is something to follow.
    """

    def __init__(self, source: Source, chain: Chain, arrays: Arrays) -> None:
        self.source, self.chain, self.arrays = source, chain, arrays
        self.states = [out.name for x in (*chain.core, *chain.behind) for out in x.outs if out.kind == STATE]
        self.slack = [x for x in chain.behind if "effort" in x.writes and x.undo][:1]
        self.carried = chain.when(*self.states, *(["effort"] if self.slack else []))

    def write(self) -> None:
        """All stretches, several side by side; each ends at the last window that is reached from its first sample."""
        source = self.source
        source.add("windows = s.first.shape[0]", "begins = np.empty(windows, np.int64)")
        self._begins()
        kept = ("wound", *(f"m_{name}" for name in self.states))
        source.add(
            f"lane_k, lane_i = np.empty({STRETCHES}, np.int64), np.empty({STRETCHES}, np.int64)",
            *(f"lane_{name} = np.empty({STRETCHES})" for name in kept),
            "lanes = upcoming = 0",
        )
        with source.under("while True:"):
            with source.under(f"while lanes < {STRETCHES} and upcoming < windows:"):
                self._start()
                source.add("lane_k[lanes], lane_i[lanes] = k, upcoming")
                source.add(*(f"lane_{name}[lanes] = {name}" for name in kept))
                source.add("lanes, upcoming = lanes + 1, upcoming + 1")
                with source.under("while upcoming < windows and begins[upcoming] < 0:"):
                    source.add("upcoming += 1")
            with source.under("if lanes == 0:"):
                source.add("break")
            source.add("samples = s.first[lane_i[0]] - lane_k[0]")
            with source.under("for x in range(1, lanes):"):
                source.add("samples = min(samples, s.first[lane_i[x]] - lane_k[x])")
            with source.under("for step in range(samples):"), source.under("for x in range(lanes):"):
                source.add("k = lane_k[x] + step", *(f"{name} = lane_{name}[x]" for name in kept))
                self._advance()
                source.add(*(f"lane_{name}[x] = {name}" for name in kept))
            self._arrive(kept)

    def fetch(self, names: list[str], k: str) -> None:
        """Signals along the log at a sample into variables."""
        for name in names:
            when = self.arrays.when(name)
            given = f"a_{name}[{k}]"
            if when is not None:
                given = f"a_{name}[{k}] if on_{name} else {self.arrays.neutral(name)}"
            self.source.add(f"{'m_' * (name in self.chain.shared)}{name} = {given}")

    def _begins(self) -> None:
        """The first sample of the stretch that begins for a window; −1 where it goes on from the window before."""
        source = self.source
        source.add("trial, at = -1, 0")
        with source.under("for i in range(windows):"):
            source.add(
                "last = s.first[i]",
                "now = np.searchsorted(s.bounds, last, side='right') - 1",
                "begin = at if now == trial and at <= last else s.bounds[now]",
            )
            self._skip_forgotten()
            source.add("begins[i] = begin if now != trial or begin != at else -1", "trial, at = now, last")

    def _skip_forgotten(self) -> None:
        """Begin later, if every state that is there forgets where it began."""
        chain = self.chain
        moved_by = list(dict.fromkeys(chain.moved_by[name] for name in self.states if name in chain.moved_by))
        if not moved_by:
            return
        there = [f"on_{name}" for name in moved_by if self.arrays.when(name) is not None]
        lasting = [x for x in (*chain.core, *chain.behind) for out in x.outs if self._lasts(out)]
        there += [f"not ({present(link.when)})" for link in (*lasting, *self.slack)]
        begins = [f"remembered(a_{name}, begin, last)" for name in moved_by]
        with self.source.under(f"if {' and '.join(there) or True}:"):
            self.source.add(f"begin = min({', '.join(begins)}, last)")

    def _lasts(self, out: Ref) -> bool:
        """Whether what a link writes is a state that does not forget where it began."""
        return out.kind == STATE and out.name not in self.chain.moved_by

    def _start(self) -> None:
        """Torque and states at the first sample of the stretch of window `upcoming`."""
        source, chain = self.source, self.chain
        source.add("k = begins[upcoming]", *(f"m_{name} = 0.0" for name in self.states))
        self.fetch(self.arrays.needed, "k")
        code = Straight(source, chain, self.arrays.needed)
        code.unmeasured("s.effort[k]")
        code.unloaded()
        source.add("expected = 0.0")
        code.rewound()
        code.started(chain.core)

    def _arrive(self, kept: tuple[str, ...]) -> None:
        """Keep what the stretches have come to that are at a window, and take out those that end there."""
        source = self.source
        source.add("x = 0")
        with source.under("while x < lanes:"):
            source.add("i = lane_i[x]", "lane_k[x] += samples")
            with source.under("if lane_k[x] == s.first[i]:"):
                source.add(*(f"w.states[{j}, i] = lane_{name}[x]" for j, name in enumerate(kept)), "lane_i[x] = i + 1")
                with source.under("if i + 1 == windows or begins[i + 1] >= 0:"):
                    source.add("lanes -= 1")
                    moved = ("k", "i", *kept)
                    source.add(*(f"lane_{name}[x] = lane_{name}[lanes]" for name in moved), "continue")
            source.add("x += 1")

    def _advance(self) -> None:
        """From sample `k` to the next one."""
        source, chain, names = self.source, self.chain, self.arrays.needed
        self.fetch(names, "k")
        code = Straight(source, chain, [*names, "wound"])
        source.add("before = wound")
        code.known.add("before")
        code.behind({"inner"}, True)
        code.behind({"lost"}, True)
        code.behind({"effort"}, True)
        moved = self._core()
        for link in moved:
            code.link(link)
        rest = [x for x in chain.core if x not in moved]
        code.need(sorted(out.name for link in rest for out in link.outs))
        if asking := [*self._after_law(), *self.slack]:
            with source.under(f"if {' or '.join(present(x.when) for x in asking)}:"):
                self._law(code, rest)
        late = sorted(
            {n for x in chain.behind if x.writes & {"lost", "effort", "measured"} for n in x.reads} & set(names)
        )
        self.fetch(late, "k + 1")
        code.unmeasured("s.effort[k + 1]")
        if not self.slack:
            code.unloaded()
        else:
            with source.under(f"if {present(self.slack[0].when)}:"):
                code.behind({"lost"}, True)
                source.add("expected = wound")
                code.rewound()
            with source.under("else:"):
                code.unloaded()

    def _core(self) -> list[Link]:
        """Links in front of the law that move a state, and those that they read."""
        found: list[Link] = []
        for link in reversed(self.chain.core):
            states = {out.name for out in link.outs if out.kind == STATE}
            if states or any(link.writes & other.reads for other in found):
                found.insert(0, link)
        return found

    def _after_law(self) -> list[Link]:
        """Links behind the law that move a state."""
        return [x for x in self.chain.behind if x.writes & set(self.states)]

    def _law(self, code: Straight, core: list[Link]) -> None:
        """The torque that the law predicts from here, and the states behind it."""
        for link in core:
            code.link(link)
        code.law("wound")
        code.behind({"inner", "grip", "turned"}, True)
        for link in self._after_law():
            if "turned" not in link.writes:
                code.link(link)
