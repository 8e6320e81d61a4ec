"""Source of the loop that steps many robots, whose joints lie end to end, block by block.

What a row of parameters gives once and for all is computed beforehand.
"""

from __future__ import annotations

from hqpipe.machine.compose.lanes import Lanes
from hqpipe.machine.compose.rows import SAMPLES, WOUND, Memory
from hqpipe.machine.compose.source import Source, constants
from hqpipe.machine.compose.wiring import CONSTANT, PARAMETER, Chain, Link, Ref

VIEWS = {
    "raw_command": "q_des",
    "raw_position": "q",
    "command": "q_des",
    "position": "q",
    "velocity": "qd",
    "sliding": "qd",
}
ARGUMENTS = "p, d, on, alike, tau, m, q_des, q, qd, joints"


def write_batches(source: Source, chain: Chain) -> None:
    """`derive`, which fills the columns that follow from a row, and `step_batch`; the flags of `step_batch` are `FLAGS`."""
    names = [name for constant in chain.constants for name in constant.names]
    with source.function("derive", "p, out", "Columns that follow from a row of parameters."):
        constants(source, chain)
        source.add(*(f"out[{i}] = c_{name}" for i, name in enumerate(names)))
    lanes = _Batch(source, chain, names)
    with source.function("step_batch", ARGUMENTS, "Robots by one sample, in place; see hqpipe.machine.chain."):
        source.add("block = p.shape[1]")
        with source.hole() as arrays:
            with source.under("for start in range(0, tau.shape[0], block):"):
                lanes.write()
            arrays += [f"b_{name} = np.empty(block)" for name in lanes.buffers]
    source.add("", "", f"FLAGS = {tuple(lanes.flags)!r}", f"CONSTANTS = {len(names)}")
    source.add(f"DELAYS = {tuple(link.by for link in lanes.memory.delays)!r}")


class _Batch(Lanes):
    def __init__(self, source: Source, chain: Chain, names: list[str]) -> None:
        super().__init__(source, chain, VIEWS, of_the_log=False)
        self.memory, self._constants = Memory(chain), {name: i for i, name in enumerate(names)}

    def place(self, ref: Ref) -> str:
        if ref.kind == PARAMETER:
            return f"p[{ref.column}, i]"
        return (
            f"d[{self._constants[ref.name]}, i]"
            if ref.kind == CONSTANT
            else f"m[{self.memory.of[ref.name]}, start + i]"
        )

    def text(self, ref: Ref) -> str:
        if ref.name == "time":
            return f"m[{SAMPLES}, start + i] * p[{self.chain.column('setting', 'sample_time')}, i]"
        return super().text(ref)

    def write(self) -> None:
        """One sample of a block."""
        source, limit = self.source, self.chain.column("setting", "effort_limit")
        timed = [link.when for link in self.links if link.call is None or "time" in link.reads]
        self._start()
        for link in self.links:
            if link.call is None:
                self._delay(link)
            elif link in self.chain.ahead:
                self.link(link)
        source.add(f"following = {self.buffer('following')}")
        self.advance()
        with source.under(f"if {self.on(self.loaded)}:"):
            self.measure(self.buffer("measured"))
            self.loop(f"tau[start + i] = min(max(measured[i], -p[{limit}, i]), p[{limit}, i])")
        with source.under("else:"):
            self.loop("tau[start + i] = following[i]")
        self.loop(f"m[{WOUND}, start + i] = following[i]")
        with source.under(f"if asleep or {self._any(timed)}:"):
            self.loop(f"m[{SAMPLES}, start + i] += 1.0")

    def _any(self, whens: list[tuple[int, ...]]) -> str:
        return self.on(dict.fromkeys(column for when in whens for column in when))

    def _start(self) -> None:
        """Inputs of a block, and the memory of joints that have just been reset."""
        source = self.source
        source.add("size = min(block, tau.shape[0] - start)", "asleep, in_step = counts(m, start, size)")
        speed, opening = (self.chain.column("setting", name) for name in ("flow_per_speed", "flow_per_opening"))
        flow = f"p[{speed}, i] * abs(qd[start + i]) + p[{opening}, i] * abs(q_des[start + i] - q[start + i])"
        drawn = [link.when for link in self.links if "demand" in link.reads]
        source.add(f"demand = {self.buffer('demand')}")
        self.known.add("demand")
        with source.under(f"if asleep or {self._any(drawn)}:" if drawn else "if asleep:"):
            self.loop(f"demand[i] = {flow}")
            with source.under("for robot in range(0, size, joints):"):
                source.add("demand[robot : robot + joints] = demand[robot : robot + joints].sum()")
        with source.under("if asleep:"), source.under("for i in range(size):"):
            source.add("k = start + i")
            with source.under(f"if m[{SAMPLES}, k] == 0.0:"):
                source.add(
                    "row = m[:, k].copy()", "begin(p[:, i].copy(), row, tau[k], q_des[k], q[k], qd[k], demand[i])"
                )
                source.add("m[:, k] = row")
        source.add(*(f"{name} = {array}[start : start + size]" for name, array in VIEWS.items()))
        source.add(f"wound = m[{WOUND}, start : start + size]")

    def _delay(self, link: Link) -> None:
        name, at = link.outs[0].name, self.memory.delays.index(link)
        self.need([name])
        with self.source.under(f"if {self.on(link.when)}:"):
            if len(self.writers(name)) == 1:
                self.loop(f"{self.buffer(name)}[i] = {name}[i]")
                self.source.add(f"{name} = b_{name}")
            given = f"{self.memory.rings[link.name]}, {len(self._constants) + 2 * at}, alike[{at}] and in_step"
            self.source.add(f"delayed_block(d, m, {given}, {name}, start, size)")
