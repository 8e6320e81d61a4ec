"""Source of the loops over a log: free running in windows that restart from the logged torque.

Links that hang on inputs alone run once along the log, each into arrays of its own, so that a change of one number
leaves what lies before it as it was. What the law reads of them is laid out so that windows lie side by side, and law and
links behind it run over all windows at once.
"""

from __future__ import annotations

from collections.abc import Iterable

from hqpipe.machine.compose.balances import Balance, write_balances
from hqpipe.machine.compose.lanes import Lanes
from hqpipe.machine.compose.source import Source, call, constants, constants_of, present, scalar, started
from hqpipe.machine.compose.trials import write_follow
from hqpipe.machine.compose.wiring import PARAMETER, SIGNAL, STATE, Call, Chain, Link, Ref
from hqpipe.machine.signals import INPUTS, NEUTRAL

DELAYED = ("command", "position", "velocity", "sliding")
RAW = {"raw_command": "command", "raw_position": "position", "sliding": "velocity"}


class Arrays:
    """Which signals are arrays along the log, and which of them the law and what lies behind it need.

    Attributes:
        along: names of all. needed: of those. balances: name of a link → what the search for the start of its state hangs on.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.along = set(INPUTS) | {out.name for x in chain.ahead for out in x.outs if out.kind == SIGNAL}
        self.along |= {out.name for x in chain.ahead for out in x.outs if out.name in chain.shared}
        for name in NEUTRAL:
            value = chain.neutral[name]
            if name not in self.along and isinstance(value, Ref) and value.kind == SIGNAL and value.name in self.along:
                self.along.add(name)
        running = (*chain.core, *chain.behind)
        calls = [c for x in running for c in (x.call, x.undo) if c] + [chain.law, chain.plain]
        read = {ref.name for made in calls for ref in made.args if ref.kind in (SIGNAL, STATE)}
        own = {out.name for x in running for out in x.outs}
        self.needed = sorted((read & self.along) - own)
        self.balances = {link.name: Balance(chain, self, link) for link in chain.ahead if link.balance}

    def when(self, name: str) -> tuple[int, ...] | None:
        """Columns of which one is not 0 where the array of a signal holds; None: always."""
        value, writers = self.chain.neutral.get(name), self.chain.writers(name)
        if name in INPUTS or (isinstance(value, Ref) and value.kind == SIGNAL) or not all(x.when for x in writers):
            return None
        return self.chain.when(name) or tuple(dict.fromkeys(c for x in writers for c in x.when))

    def neutral(self, name: str) -> str:
        """The number or parameter that stands where the array does not hold."""
        value = self.chain.neutral.get(name, 0.0)
        return scalar(value) if isinstance(value, Ref) else repr(value)


class Stages:
    """The steps along a log in their order, and what each needs to be computed anew for.

    Attributes:
        rows: name of a step → rows of the scratch that its outputs fill. plan: of each step its columns (those that it reads,
            those of which one is not 0 where it is present), and names that it reads and writes.
    """

    def __init__(self, chain: Chain, arrays: Arrays) -> None:
        self.rows: dict[str, list[int]] = {}
        self.plan: list[tuple] = []
        self.count = 0
        late, dt = (chain.column("setting", name) for name in ("speed_late", "sample_time"))
        for name in DELAYED:
            by = [x.by for x in chain.late if name in x.writes] + [late] * (name == "sliding")
            self.rows[name] = self._take(1)
            source = RAW.get(name, name) if name == "sliding" else f"raw_{name}"
            self.plan.append(((*by, dt), tuple(by), (source,), (name,)))
        for link in chain.ahead:
            outs = [out.name for out in link.outs if out.kind == SIGNAL or out.name in chain.shared]
            self.rows[link.name] = self._take(len(outs))
            calls = [link.call, *(s for s in (link.starts or {}).values() if isinstance(s, Call))] if link.call else []
            columns = link.columns | ({dt} if link.call is None else set())
            neutral = [chain.neutral.get(name) for name in chain._aliases(link.reads)]
            columns |= {ref.column for ref in neutral if isinstance(ref, Ref) and ref.kind == PARAMETER}
            for constant in chain.constants:
                if set(constant.names) & constants_of(chain, calls):
                    columns |= {r.column for r in constant.call.args if r.kind == PARAMETER}
            reads = set(link.reads)
            if balance := arrays.balances.get(link.name):
                columns |= balance.columns
                reads |= set(balance.names)
            self.plan.append((tuple(sorted(columns)), link.when, tuple(sorted(chain._aliases(reads))), tuple(outs)))
        self.laid = len(self.plan)
        for name in arrays.needed:
            reads = tuple(sorted(chain._aliases([name])))
            self.plan.append(((), arrays.when(name) or (), reads, ()))

    def _take(self, count: int) -> list[int]:
        self.count += count
        return list(range(self.count - count, self.count))


def write_windows(source: Source, chain: Chain) -> None:
    """`errors_of_windows` and what it calls; `PLAN`, `SCRATCH`, `LAID` and `LINES` say what it needs."""
    arrays = Arrays(chain)
    stages = Stages(chain, arrays)
    write_balances(source, arrays.balances.values())
    _along(source, chain, arrays, stages)
    write_follow(source, chain, arrays)
    run = _Run(source, chain, arrays)
    run.write()
    names = ", ".join(f"a_{name}" for name in arrays.needed)
    with source.function(
        "errors_of_windows", "p, s, w, out, anew, slot", "Predicted less logged torque, see hqpipe.machine.chain."
    ):
        source.add(f"{names}, = along(p, s, w, anew, slot)")
        for i, name in enumerate(arrays.needed):
            with source.under(f"if anew[{stages.laid + i}]:"):
                source.add(f"lay_out(a_{name}, s.first, w.laid[{i} + {len(arrays.needed)} * slot[{stages.laid + i}]])")
        source.add(f"follow(p, s, w, {names})", f"run(p, s, w, out, slot[{stages.laid}:])")
    source.add("", "", f"PLAN = {stages.plan!r}", f"SCRATCH = {stages.count}", f"LAID = {len(arrays.needed)}")
    source.add(f"LINES = {run.lines}", f"STATES = {len(run.states) + 1}")


def _along(source: Source, chain: Chain, arrays: Arrays, stages: Stages) -> None:
    """The function that runs along the log and returns the arrays that the law needs."""
    with source.function("along", "p, s, w, anew, slot", "Signals along the log that hang on inputs alone."):
        source.add(f"dt = p[{chain.column('setting', 'sample_time')}]")
        calls = [c for x in chain.ahead for c in (x.call, *(x.starts or {}).values()) if isinstance(c, Call)]
        constants(source, chain, only=constants_of(chain, calls))
        source.add("a_raw_command, a_raw_position, a_time, a_demand = s.command, s.position, s.time, s.demand")
        known = {"raw_command", "raw_position", "time", "demand"}
        for i, name in enumerate(DELAYED):
            raw, by = RAW.get(name, name), stages.plan[i][1]
            source.add(f"a_{name} = s.{raw}")
            known.add(name)
            if stages.plan[i][1]:
                late = chain.column("setting", "speed_late")
                order = sorted((x.by for x in chain.late if name in x.writes), reverse=True)
                lags = [f"p[{c}] / dt" for c in order] + [f"p[{c}]" for c in by if c == late]
                with source.under(f"if {present(by)}:"):
                    row = stages.rows[name][0]
                    source.add(f"out = w.along[{row} + {stages.count} * slot[{i}]]")
                    with source.under(f"if anew[{i}]:"):
                        source.add(*(f"lag_{j} = {lag}" for j, lag in enumerate(lags)))
                        with source.under("for trial in range(s.bounds.shape[0] - 1):"):
                            source.add("first, last = s.bounds[trial], s.bounds[trial + 1] - 1")
                            with source.under("for k in range(first, last + 1):"):
                                at = " - ".join(["k", *(f"lag_{j}" for j in range(len(lags)))])
                                source.add(f"out[k] = delayed(s.{raw}, first, last, {at})")
                    source.add(f"a_{name} = out")
        for i, link in enumerate(chain.ahead, start=len(DELAYED)):
            _stage(source, chain, arrays, stages, link, i, known)
        _need(source, chain, arrays, arrays.needed, known)
        source.add(f"return ({', '.join(f'a_{name}' for name in arrays.needed)},)")


def _need(source: Source, chain: Chain, arrays: Arrays, names: Iterable[str], known: set[str]) -> None:
    """Arrays of signals that are the same as others where nothing writes them; a stand-in where there is no array."""
    for name in names:
        if name in known or name not in arrays.along:
            continue
        value = chain.neutral.get(name)
        if isinstance(value, Ref) and value.kind == SIGNAL:
            _need(source, chain, arrays, [value.name], known)
            source.add(f"a_{name} = a_{value.name}")
        else:
            source.add(f"a_{name} = w.along[0]")
        known.add(name)


def _stage(source: Source, chain: Chain, arrays: Arrays, stages: Stages, link: Link, at: int, known: set[str]) -> None:
    """One link along all trials, each into arrays of its own."""
    outs = [out for out in link.outs if out.kind == SIGNAL or out.name in chain.shared]
    extra = arrays.balances[link.name].names if link.balance else []
    _need(source, chain, arrays, [*sorted(link.reads), *extra, *(out.name for out in outs)], known)
    states = [out.name for out in link.outs if out.kind == STATE]

    def text(ref: Ref) -> str:
        if ref.kind in (SIGNAL, STATE) and ref.name not in states:
            when = arrays.when(ref.name)
            if ref.name not in arrays.along:
                return arrays.neutral(ref.name)
            if when is None:
                return f"a_{ref.name}[k]"
            return f"(a_{ref.name}[k] if on_{ref.name} else {arrays.neutral(ref.name)})"
        return scalar(ref)

    source.add(*(_flag(link, ref, arrays) for ref in _maybe(link, arrays, states)))
    with source.under(f"if {present(link.when)}:"):
        rows, behind = stages.rows[link.name], f"{stages.count} * slot[{at}]"
        source.add(*(f"o_{out.name} = w.along[{row} + {behind}]" for out, row in zip(outs, rows, strict=True)))
        with source.under(f"if anew[{at}]:"):
            if link.call and not states:
                # Of one range from 0, so that the compiler knows no index below it and works on several samples at a time.
                with source.under(f"for k in range(o_{outs[0].name}.shape[0]):"):
                    given = ", ".join(f"o_{out.name}[k]" for out in outs)
                    source.add(f"{given} = {call(source, link.call, text)}")
            else:
                _along_trials(source, chain, arrays, link, outs, text)
        source.add(*(f"a_{out.name} = o_{out.name}" for out in outs))
    for out in outs:
        known.add(out.name)


def _along_trials(source: Source, chain: Chain, arrays: Arrays, link: Link, outs: list[Ref], text) -> None:
    """A delay, or a link with states, one trial after the other."""
    with source.under("for trial in range(s.bounds.shape[0] - 1):"):
        source.add("first, last = s.bounds[trial], s.bounds[trial + 1] - 1", "k = first")
        if link.call is None:
            name = link.outs[0].name
            with source.under("for k in range(first, last + 1):"):
                source.add(f"o_{name}[k] = delayed(a_{name}, first, last, k - p[{link.by}] / dt)")
            return
        for name, start in link.starts.items():
            source.add(f"m_{name} = {_started(source, arrays, link, start, text)}")
        with source.under("for k in range(first, last + 1):"):
            given = ", ".join(f"m_{out.name}" if out.kind == STATE else f"o_{out.name}[k]" for out in link.outs)
            source.add(f"{given} = {call(source, link.call, text)}")
            source.add(*(f"o_{out.name}[k] = m_{out.name}" for out in outs if out.kind == STATE))


def _maybe(link: Link, arrays: Arrays, states: list[str]) -> list[str]:
    calls = [c for c in (link.call, *(link.starts or {}).values()) if isinstance(c, Call)]
    names = {r.name for c in calls for r in c.args if r.kind in (SIGNAL, STATE)} - set(states)
    return sorted(name for name in names if name in arrays.along and arrays.when(name) is not None)


def _flag(link: Link, name: str, arrays: Arrays) -> str:
    """Whether the array of a signal holds before a link."""
    chain = arrays.chain
    earlier = chain.ahead[: chain.ahead.index(link)]
    columns = tuple(dict.fromkeys(c for x in earlier if name in x.writes for c in x.when))
    return f"on_{name} = {present(columns) if columns else False}"


def _started(source: Source, arrays: Arrays, link: Link, start: object, text) -> str:
    if isinstance(start, tuple):
        return f"balance_{link.balance}(p, s, first, last, {arrays.balances[link.name].given})"
    return started(source, start, text)


class _Run(Lanes):
    """Source of `run`, the law and what lies behind it over all windows at once.

    What a signal is at a sample of the windows is a row of `lines`, or of what is laid out, by its number: views of them would
    cost more than the sums where windows are few.
    """

    FLAG = "on_{}"

    def __init__(self, source: Source, chain: Chain, arrays: Arrays) -> None:
        super().__init__(source, chain, arrays.needed, of_the_log=True)
        self.states = [out.name for x in (*chain.core, *chain.behind) for out in x.outs if out.kind == STATE]
        self._rows = {name: i for i, name in enumerate(arrays.needed)}
        self._when = {name: arrays.when(name) for name in arrays.needed}
        self._absent = {name: arrays.neutral(name) for name, when in self._when.items() if when is not None}

    def place(self, ref: Ref) -> str:
        return f"m_{ref.name}[i]" if ref.kind == STATE else scalar(ref)

    def element(self, array: str) -> str:
        return f"lines[{array}, i]"

    def text(self, ref: Ref) -> str:
        # Of the log, or a state that another link has left along it.
        of_the_log = ref.kind in (SIGNAL, STATE) and ref.name in self._rows
        return f"l_{ref.name}[k_{ref.name}, i]" if of_the_log else super().text(ref)

    def is_array(self, name: str) -> bool:
        return name not in self._rows

    def write(self) -> None:
        source, chain = self.source, self.chain
        after = {n for x in chain.behind if x.writes & {"lost", "effort", "measured"} for n in x.reads} & set(
            self._rows
        )
        says = "Of the base's law and what lies behind it over all windows at once: predicted less logged torque."
        with source.function("run", "p, s, w, out, slot", says):
            calls = [x.call for x in (*chain.core, *chain.behind)] + [chain.law, chain.plain]
            source.add("size, lines, wound = s.first.shape[0], w.lines, 0")
            constants(source, chain, only=constants_of(chain, calls))
            source.add(*(f"m_{name} = lines[{1 + i}]" for i, name in enumerate(self.states)))
            with source.hole() as head:
                with source.under("for k in range(s.steps):"):
                    self._fetch(self._rows, "k")
                    source.add(f"following = {self.buffer('even')} if k % 2 == 0 else {self.buffer('odd')}")
                    self.advance()
                    source.add("measured = following")
                    with source.under(f"if {self.on(self.loaded)}:"):
                        self._fetch(sorted(after), "k + 1")
                        self.measure(self.buffer("measured"))
                    missed = f"{self.element('measured')} - s.target[k + 1, i]"
                    self.loop(f"out[k, i] = 0.0 if np.isnan(s.target[k + 1, i]) else {missed}")
                    source.add("wound = following")
                self._begin(head)

    def _begin(self, head: list[str]) -> None:
        """Flags, rows, and where signals are taken from, once it is known which there are."""
        absent = {name: self.buffer(f"absent_{name}") for name in self._absent}
        fetched = {}
        for name, row in self._rows.items():
            fetched[name] = f"w.laid[{row} + {len(self._rows)} * slot[{row}]]"
            if name in absent:
                fetched[name] += f" if {self.on(self._when[name])} else lines[{absent[name]} : {absent[name]} + 1]"
        head += [f"on_{i} = {present(when)}" for i, when in enumerate(self.flags)]
        head += [f"b_{name} = {1 + len(self.states) + i}" for i, name in enumerate(self.buffers)]
        head += [f"lines[{row}, :] = {self._absent[name]}" for name, row in absent.items()]
        head += [f"l_{name} = {taken}" for name, taken in fetched.items()]

    def _fetch(self, names: Iterable[str], k: str) -> None:
        """Where signals along the log stand at a sample of the windows."""
        for name in names:
            when = self._when[name]
            self.source.add(f"k_{name} = {k} if {self.on(when)} else 0" if when else f"k_{name} = {k}")

    @property
    def lines(self) -> int:
        """Arrays over the windows that it works with."""
        return 1 + len(self.states) + len(self.buffers)
