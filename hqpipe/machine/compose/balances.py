"""Source of the search for the start of a state that only a whole trial tells.

The torques of the law must add up to the logged ones. For a state that is tried, each sample hangs on the logged torque, not on
the sample before it, so that links without a state of their own are loops over many samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from hqpipe.machine.compose.lanes import Lanes
from hqpipe.machine.compose.source import Source, call, constants, constants_of, present, scalar, started
from hqpipe.machine.compose.wiring import PARAMETER, SIGNAL, STATE, Call, Chain, Link, Ref

if TYPE_CHECKING:
    from hqpipe.machine.compose.windows import Arrays

NO_LIMIT = 1e299  # of a state: none of a machine is as large


class Balance:
    """What the search for the start of a state hangs on.

    Attributes:
        links: that change the sum of the torques, from the one with the state on. undone: behind the law, between its torque
            and the logged one. names: of the signals along the log that are read. columns: of the parameters.
    """

    def __init__(self, chain: Chain, arrays: Arrays, link: Link) -> None:
        self.chain, self.arrays, self.link = chain, arrays, link
        rest = chain.ahead[chain.ahead.index(link) :]
        self.links = [x for x in rest if x.call is not None and not x.only_delays]
        self.undone = [x for x in reversed(chain.behind) if "measured" in x.writes and x.undo]
        self.names = self._names(rest)
        self.columns = self._columns()

    @property
    def state(self) -> str:
        return self.link.balance

    @property
    def calls(self) -> list[Call]:
        """All calls of a sample."""
        chain, links = self.chain, (*self.links, *self.chain.core)
        starts = [s for x in links for s in x.starts.values()]
        made = [s for start in starts for s in (start if isinstance(start, tuple) else (start,)) if isinstance(s, Call)]
        return [*(x.call for x in links), *made, chain.law, chain.plain, *(x.undo for x in self.undone)]

    @property
    def given(self) -> str:
        """The signals as arguments."""
        return ", ".join(f"a_{name}" for name in self.names)

    def _names(self, rest: list[Link]) -> list[str]:
        own = {n for x in rest[1:] for n in x.writes} - {"opening"}
        states = {out.name for out in self.link.outs if out.kind == STATE}
        read = {ref.name for made in self.calls for ref in made.args if ref.kind in (SIGNAL, STATE)}
        return sorted(((read & self.arrays.along) - own - states) | {"opening", "error"})

    def _columns(self) -> set[int]:
        chain = self.chain
        found = {chain.column("setting", "sample_time"), chain.column("setting", "held"), chain.gain, *chain.bent}
        found |= {c for x in (*self.links, *chain.core, *self.undone) for c in x.when}
        found |= {c for name in self.names for c in self.arrays.when(name) or ()}
        needed = constants_of(chain, self.calls)
        own = [constant for constant in chain.constants if needed & set(constant.names)]
        found |= {c for constant in own for c in constant.when}
        refs = [ref for made in (*self.calls, *(constant.call for constant in own)) for ref in made.args]
        refs += [value for ref in refs if isinstance(value := chain.neutral.get(ref.name), Ref)]
        return found | {ref.column for ref in refs if ref.kind == PARAMETER}


def write_balances(source: Source, balances: Iterable[Balance]) -> None:
    """`balance_<state>` for each state whose start only the whole trial tells."""
    for balance in balances:
        _Samples(source, balance).write()
        _balance(source, balance)


class _Samples(Lanes):
    """Source of `missing_<state>`, the law over many samples of one trial; states are passed on from one to the next."""

    FLAG = "on_{}"

    def __init__(self, source: Source, balance: Balance) -> None:
        super().__init__(source, balance.chain, (), of_the_log=True)
        self.balance, self.links = balance, [*balance.links, *balance.chain.core]
        self._states = [out.name for x in self.links for out in x.outs if out.kind == STATE]
        self._own: set[str] = set()
        self.known |= {*balance.names, *self._states, "behind", "inner", "effort", "wound"}

    def place(self, ref: Ref) -> str:
        if ref.kind != STATE:
            return scalar(ref)
        if ref.name in self._states:
            return f"m_{ref.name}" if ref.name in self._own else f"h_{ref.name}[i]"
        return f"{ref.name}[i]"  # a state that another link has left along the log

    def link(self, link: Link) -> None:
        self._own = {out.name for out in link.outs if out.kind == STATE}
        super().link(link)
        if shared := sorted(self._own & self.chain.shared):
            with self.source.under("else:"):
                self.loop(*(f"h_{name}[i] = m_{name}" for name in shared))
        self._own = set()

    def after_sample(self, link: Link) -> list[str]:
        """What other links read of its states; and an end where a limit has been reached."""
        lines = [f"h_{name}[i] = m_{name}" for name in sorted(self._own & self.chain.shared)]
        if link is self.balance.link:
            lines += [
                f"if abs(m_{self.balance.state}) >= most and (begin + i) * stride >= steps:",
                "    size, over = i + 1, True",
                "    break",
            ]
        return lines

    def write(self) -> None:
        source, chain, balance = self.source, self.chain, self.balance
        says = "Torque, N·m, that a start leaves open by the end of a trial, and over how many samples."
        args = f"p, start, most, stride, steps, a_behind, {balance.given}"
        with source.function(f"missing_{balance.state}", args, says):
            constants(source, chain, only=constants_of(chain, balance.calls))
            source.add("p = p.copy()", f"p[{chain.column('setting', 'sample_time')}] *= stride")
            with source.hole() as head:
                source.add("total, end, over = 0.0, 0, False")
                with source.under("while end < a_behind.shape[0] - 1 and not over:"):
                    source.add("begin, size = end, min(SAMPLES, a_behind.shape[0] - 1 - end)")
                    self._fetch()
                    self._begin()
                    for link in self.links:
                        self.link(link)
                    following = self.buffer("following")
                    self.law(following)
                    self.loop(f"total += stride * ({following}[i] - behind[i])")
                    source.add("end = begin + size")
                head += [f"m_{name} = {'start' if name == balance.state else '0.0'}" for name in self._states]
                head += [f"on_{i} = {present(when)}" for i, when in enumerate(self.flags)]
                own = [f"h_{name}" for name in self._states if name in chain.shared]
                head += [f"{name} = np.empty(SAMPLES)" for name in (*(f"b_{n}" for n in self.buffers), *own)]
                absent = {name: balance.arrays.neutral(name) for name in balance.names if balance.arrays.when(name)}
                head += [f"b_absent_{name} = np.full(SAMPLES, {value})" for name, value in absent.items()]
            source.add("return a_behind[end] - a_behind[0] - total, end * stride")

    def _fetch(self) -> None:
        """The arrays of signals along the trial at these samples."""
        for name in ("behind", *self.balance.names):
            when = self.balance.arrays.when(name) if name != "behind" else None
            given = f"a_{name}[begin : begin + size]"
            self.source.add(
                f"{name} = {given} if {self.on(when)} else b_absent_{name}" if when else f"{name} = {given}"
            )
        self.source.add("inner, effort, wound = behind, behind, behind")
        for name in sorted({n for x in self.links for n in x.writes} & set(self.balance.names)):
            # Written in place from here on, which the compiler has to know to work on several samples at a time.
            self.loop(f"{self.buffer(name)}[i] = {name}[i]")
            self.source.add(f"{name} = {self.buffer(name)}")

    def _begin(self) -> None:
        """States at the first sample, but for the one that is tried."""
        starts = {n: start for x in self.links for n, start in x.starts.items() if n != self.balance.state}
        if starts:
            with self.source.under("if begin == 0:"):
                self.source.add("i = 0")
                self.source.add(*(f"m_{n} = {started(self.source, start, self.text)}" for n, start in starts.items()))


def _balance(source: Source, balance: Balance) -> None:
    """`balance_<state>`: first with few samples, then with all."""
    chain, arrays = balance.chain, balance.arrays
    limit, known = balance.link.starts[balance.state]
    held, dt = (f"p[{chain.column('setting', name)}]" for name in ("held", "sample_time"))
    says = "What a state is at the start of a trial, so that the torques of the law add up to the logged ones."

    def text(ref: Ref) -> str:
        if ref.kind == SIGNAL and ref.name == "measured":
            return "behind[i]"
        if ref.kind != SIGNAL or ref.name not in balance.names:
            return scalar(ref)
        when, given = arrays.when(ref.name), f"a_{ref.name}[first + i]"
        return f"({given} if {present(when)} else {arrays.neutral(ref.name)})" if when else given

    with source.function(f"balance_{balance.state}", f"p, s, first, last, {balance.given}", says):
        constants(source, chain, only=constants_of(chain, [limit, known, *(x.undo for x in balance.undone)]))
        with source.under(f"if {held} >= 0.0 and s.time[first] == 0.0:"):
            source.add("i = 0", f"return {call(source, known, text)}")
        source.add("behind = s.effort[first : last + 1].copy()")
        for link in balance.undone:
            with source.under(f"if {present(link.when)}:"), source.under("for i in range(behind.shape[0]):"):
                source.add(f"behind[i] = {call(source, link.undo, text)}")
        source.add(f"most = {call(source, limit, scalar)}", "start, gain = 0.0, 0.0")
        source.add(f"rough = max(1, min(int(ROUGH / {dt}), (last - first) // FEWEST))")
        with source.under("for stride in (rough, 1):"):
            source.add("few = stride > 1", "x_behind = behind[::stride].copy() if few else behind")
            for name in balance.names:
                all_of_them = f"a_{name}[first : last + 1"
                source.add(f"x_{name} = {all_of_them} : stride].copy() if few else {all_of_them}]")
            _passes(source, balance)
        source.add("return start")


def _passes(source: Source, balance: Balance) -> None:
    """`start` after which the torques add up, and `gain`, how much torque it is worth, from a first guess of both."""
    given = ", ".join(f"x_{name}" for name in ("behind", *balance.names))
    source.add("low, high, before, left = -most, most, start, 0.0")
    with source.under("for _ in range(PASSES):"):
        source.add(
            f"missing, samples = missing_{balance.state}(p, start, most, stride, s.steps, {given})",
            "low, high = (start, high) if missing > 0.0 else (low, start)",
            "doubt = 1.0  # of the gain: what a start is worth; at first all of it, then as the last two tell",
        )
        with source.under("if gain == 0.0:"):
            source.add(f"gain = max(p[{balance.chain.gain}] * samples, 1e-300)")
        with source.under("elif start != before:"):
            source.add("told = (left - missing) / (start - before)")
            with source.under(f"if told > 0.0 or most < {NO_LIMIT}:"):
                source.add("last_gain, gain = gain, max(told, 1e-300)")
                source.add("doubt = min(abs(gain / last_gain - 1.0), 1.0)")
            with source.under("else:  # rounding: where there is no limit, more of a start is always worth more"):
                source.add("doubt = 0.0")
        source.add("before, left, wanted = start, missing, start + missing / gain")
        with source.under("if wanted < low or wanted > high:  # the limit takes from what the start is worth"):
            source.add("wanted, doubt = 0.5 * (low + high), 1.0")
        source.add("close = doubt * abs(wanted - start) < CLOSE * abs(wanted)", "start = wanted")
        with source.under("if close:"):
            source.add("break")
