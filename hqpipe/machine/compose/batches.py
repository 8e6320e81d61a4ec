"""Source of the loop that steps many robots: their joints lie end to end, and each link is one loop over a block of them.

So the compiler works on several joints per instruction, and a link that no joint has is left out. What a row of parameters gives
once and for all is computed beforehand.
"""

from __future__ import annotations

from collections.abc import Iterable

from hqpipe.machine.compose.rows import SAMPLES, WOUND, Memory
from hqpipe.machine.compose.source import Source, call, constants
from hqpipe.machine.compose.wiring import CONSTANT, NUMBER, PARAMETER, SIGNAL, STATE, Chain, Link, Ref

VIEWS = {
    "raw_command": "q_des",
    "raw_position": "q",
    "command": "q_des",
    "position": "q",
    "velocity": "qd",
    "sliding": "qd",
}


def write_batches(source: Source, chain: Chain) -> None:
    """`derive`, which fills the columns that follow from a row, and `step_batch`; the flags of `step_batch` are `FLAGS`."""
    with source.function("derive", "p, out", "Columns that follow from a row of parameters."):
        constants(source, chain)
        names = [name for constant in chain.constants for name in constant.names]
        source.add(*(f"out[{i}] = c_{name}" for i, name in enumerate(names)))
    code = _Batch(source, chain, names)
    code.write()
    source.add("", "", f"FLAGS = {tuple(code.flags)!r}", f"CONSTANTS = {len(names)}")
    source.add(f"DELAYS = {tuple(link.by for link in code.memory.delays)!r}")


class _Batch:
    """The source of `step_batch`; a signal is an array over the joints of a block."""

    def __init__(self, source: Source, chain: Chain, names: list[str]) -> None:
        self.source, self.chain, self.memory = source, chain, Memory(chain)
        self.flags: list[tuple[int, ...]] = []
        self._constants = {name: i for i, name in enumerate(names)}
        self._known = set(VIEWS)
        self._buffers: list[str] = []
        links = (*chain.late, *chain.ahead, *chain.core, *chain.behind)
        self.links = [link for link in links if not link.logged and not link.of_the_log]
        self.torque = "wound"  # array with the torque of the base
        self._writers = {name: [x for x in self.links if name in x.writes] for x in self.links for name in x.writes}

    def on(self, when: Iterable[int]) -> str:
        """Condition of links with these columns."""
        when = tuple(when)
        if when not in self.flags:
            self.flags.append(when)
        return f"on[{self.flags.index(when)}]"

    def text(self, ref: Ref) -> str:
        """A name inside a loop over i."""
        if ref.kind == PARAMETER:
            return f"p[{ref.column}, i]"
        if ref.kind == NUMBER:
            return ref.name
        if ref.kind == CONSTANT:
            return f"d[{self._constants[ref.name]}, i]"
        if ref.kind == STATE:
            return f"m[{self.memory.of[ref.name]}, start + i]"
        if ref.name == "time":
            return f"m[{SAMPLES}, start + i] * p[{self.chain.column('setting', 'sample_time')}, i]"
        if ref.name == "wound":
            return f"{self.torque}[i]"
        value = self.chain.neutral.get(ref.name)
        if ref.name in self._known or value is None or ref.name in self._writers:
            return f"{ref.name}[i]"
        return self.text(value) if isinstance(value, Ref) else repr(value)

    def loop(self, *lines: str) -> None:
        with self.source.under("for i in range(size):"):
            self.source.add(*lines)

    def buffer(self, name: str) -> str:
        """Name of the array that a signal is written into; behind the law, the torque of before is still needed."""
        name = f"{name}_after" if name == "inner" and self.torque == "b_following" else name
        if name not in self._buffers:
            self._buffers.append(name)
        return f"b_{name}"

    def need(self, names: Iterable[str]) -> None:
        """Give signals their neutral values; one that several links write gets an array of its own to write into."""
        for name in names:
            value, writers = self.chain.neutral.get(name), self._writers.get(name, [])
            if name in self._known or value is None or name == "wound":
                continue
            if isinstance(value, Ref) and value.kind == SIGNAL:
                self.need([value.name])
            if not writers:
                continue
            if len(writers) == 1 and isinstance(value, Ref) and value.kind == SIGNAL:
                if not writers[0].when:
                    continue
                self.source.add(f"{name} = {self.text(value).removesuffix('[i]')}")
            elif writers[0].when:
                given = self.text(value) if isinstance(value, Ref) else repr(value)
                self.loop(f"{self.buffer(name)}[i] = {given}")
                self.source.add(f"{name} = {self.buffer(name)}")
            self._known.add(name)

    def link(self, link: Link) -> None:
        """One loop, where some joint has the link."""
        names = [out.name for out in link.outs if out.kind == SIGNAL]
        self.need([*sorted(link.reads), *names])
        made = call(self.source, link.call, self.text)
        places = {n: f"{self.buffer(n)}[i]" for n in names}
        outs = ", ".join(places[out.name] if out.kind == SIGNAL else self.text(out) for out in link.outs)
        self._known |= set(names)
        lines = [f"{name} = {self.buffer(name)}" for name in names]
        if link.when:
            with self.source.under(f"if {self.on(link.when)}:"):
                self.loop(f"{outs} = {made}")
                self.source.add(*lines)
        else:
            self.loop(f"{outs} = {made}")
            self.source.add(*lines)

    def delay(self, link: Link) -> None:
        name, at = link.outs[0].name, self.memory.delays.index(link)
        whole, alike = len(self._constants) + 2 * at, f"alike[{at}] and in_step"
        self.need([name])
        with self.source.under(f"if {self.on(link.when)}:"):
            if name in VIEWS and len(self._writers[name]) == 1:
                self.loop(f"{self.buffer(name)}[i] = {name}[i]")
                self.source.add(f"{name} = b_{name}")
            self.source.add(
                f"delayed_block(d, m, {self.memory.rings[link.name]}, {whole}, {alike}, {name}, start, size)"
            )

    def behind(self, names: set[str]) -> None:
        self._known -= {"inner", "effort", "grip", "lost"} & names
        for link in self.links:
            if link in self.chain.behind and link.writes & names:
                self.link(link)
        self.need(sorted({"inner", "effort", "lost"} & names))

    def array(self, name: str) -> str:
        """The array of a signal."""
        return self.text(Ref(SIGNAL, name)).removesuffix("[i]")

    def write(self) -> None:
        arguments = "p, d, on, alike, tau, m, q_des, q, qd, joints"
        with self.source.function("step_batch", arguments, "Robots by one sample, in place; see hqpipe.machine.chain."):
            self.source.add("block = p.shape[1]")
            at = len(self.source._lines)
            with self.source.under("for start in range(0, tau.shape[0], block):"):
                self._start()
                self._ahead()
                self._hydraulics()
                self._end()
            lines = [f"    b_{name} = np.empty(block)" for name in self._buffers]
            self.source._lines[at:at] = lines

    def _start(self) -> None:
        source, timed = self.source, [link for link in self.links if link.call is None or "time" in link.reads]
        self.timed = self.on(tuple(dict.fromkeys(c for link in timed for c in link.when)))
        source.add("size = min(block, tau.shape[0] - start)", "asleep, in_step = counts(m, start, size)")
        speed, opening = (self.chain.column("setting", name) for name in ("flow_per_speed", "flow_per_opening"))
        flow = f"p[{speed}, i] * abs(qd[start + i]) + p[{opening}, i] * abs(q_des[start + i] - q[start + i])"
        drawn = [link.when for link in self.links if "demand" in link.reads]
        if drawn:
            with source.under(f"if asleep or {self.on(tuple(dict.fromkeys(c for when in drawn for c in when)))}:"):
                self.loop(f"{self.buffer('demand')}[i] = {flow}")
                with source.under("for robot in range(0, size, joints):"):
                    source.add("drawn = b_demand[robot : robot + joints].sum()")
                    with source.under("for i in range(robot, robot + joints):"):
                        source.add("b_demand[i] = drawn")
            source.add("demand = b_demand")
            self._known.add("demand")
        with source.under("if asleep:"), source.under("for i in range(size):"):
            source.add("k = start + i")
            with source.under(f"if m[{SAMPLES}, k] == 0.0:"):
                demand = "b_demand[i]" if drawn else "0.0"
                source.add(
                    "row = m[:, k].copy()", f"begin(p[:, i].copy(), row, tau[k], q_des[k], q[k], qd[k], {demand})"
                )
                source.add("m[:, k] = row")
        source.add(*(f"{name} = {array}[start : start + size]" for name, array in VIEWS.items()))
        source.add(f"wound = m[{WOUND}, start : start + size]")

    def _ahead(self) -> None:
        for link in self.links:
            if link.call is None:
                self.delay(link)
            elif link in self.chain.ahead:
                self.link(link)

    def _hydraulics(self) -> None:
        chain, source = self.chain, self.source
        behind = [x for x in self.links if x in chain.behind]
        self.rubbed = chain.when("lost", "effort", *(n for x in behind for n in x.writes if n == "measured"))
        self.behind({"inner"})
        source.add(f"before = {self.array('inner')}")
        self._known.add("before")
        if slack := [x for x in behind if "effort" in x.writes]:
            self.need(["effort", "lost"])
            with source.under(f"if {self.on(slack[0].when)}:"):
                for link in (x for x in behind if "lost" in x.writes):
                    self.link(link)
            for link in slack:
                self.link(link)
        for link in (x for x in self.links if x in chain.core):
            self.link(link)
        calls = [chain.plain, chain.law]
        self.need(sorted({ref.name for made in calls for ref in made.args if ref.kind == SIGNAL}))
        self.buffer("following")
        made = [call(source, law, self.text) for law in calls]
        if chain.bent:
            with source.under(f"if {self.on(chain.bent)}:"):
                self.loop(f"b_following[i] = {made[1]}")
            with source.under("else:"):
                self.loop(f"b_following[i] = {made[0]}")
        else:
            self.loop(f"b_following[i] = {made[0]}")
        self.torque = "b_following"

    def _end(self) -> None:
        source, limit = self.source, self.chain.column("setting", "effort_limit")
        with source.under(f"if {self.on(self.rubbed)}:"):
            self.behind({"inner", "grip", "turned", "lost", "effort"})
            self.loop(f"b_measured[i] = {self.text(Ref(SIGNAL, 'effort'))} - {self.text(Ref(SIGNAL, 'lost'))}")
            source.add(f"measured = {self.buffer('measured')}")
            self._known.add("measured")
            self.behind({"measured"})
            self.loop(f"tau[start + i] = min(max(measured[i], -p[{limit}, i]), p[{limit}, i])")
        with source.under("else:"):
            self.loop("tau[start + i] = b_following[i]")
        self.loop(f"m[{WOUND}, start + i] = b_following[i]")
        with source.under(f"if asleep or {self.timed}:"):
            self.loop(f"m[{SAMPLES}, start + i] += 1.0")
